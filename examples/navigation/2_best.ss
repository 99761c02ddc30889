# The best path
# collision(robot, place) asks whether the robot would collide at a place, and moves nothing. So SQLite may ask when it
# likes, and once for each place; COST and HEURISTIC (A*) lead it to the target, and the first path is the shortest way.
robot      = "YouBot";
target_pos = [10.0, 9.0];

directions = [[0, 1],[0,-1],[1,-1],[-1,-1],[1, 0],[-1, 0],[-1, 1],[1, 1]];

SELECT (this + cur_pos) FROM directions
WHERE  target_pos == this + cur_pos

START WITH cur_pos = position(robot)
CONNECT BY COST norm(this) HEURISTIC distance(target_pos, this + cur_pos)
           UNIQUE MAXIMUM 1
           cur_pos = cur_pos + this
STOP WITH  target_pos == this + cur_pos OR collision(robot, this + cur_pos)
AS list;
