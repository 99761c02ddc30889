 robot      = "YouBot";
 start_pos  = position(robot);
 target_pos = [10.0, 9.0];

 directions = [[0, 1],[0,-1],[1,-1],[-1,-1],[1, 0],[-1, 0],[-1, 1],[1, 1]];

 SELECT (this + cur_pos) FROM directions
 WHERE  target_pos == move(robot, this + cur_pos)

 START WITH cur_pos = start_pos, level = 1
 CONNECT BY MEMORIZE 20 MAXIMUM 1000
            cur_pos = move(robot, cur_pos + this),
            level = level+1
 STOP WITH  target_pos == move(robot, this+cur_pos) OR
            distance(target_pos, this+cur_pos) > 0.5 * (20-level) OR
            IF(checkCollision(robot);
               playSound("/usr/share/sounds/ubuntu/stereo/bell.ogg"),
               True) # ; else is not required here ...
 AS list;
