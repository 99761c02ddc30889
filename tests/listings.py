"""The listings of the paper, as printed, and the function that its Towers of Hanoi call."""

from __future__ import annotations

from typing import Any

MOVES = [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]


def move(step: Any, towers: Any) -> Any:
    """It changes its argument; an empty list says that the step is not allowed."""
    if not towers or not towers[step[0]]:
        pass
    elif not towers[step[1]] or towers[step[1]][-1] > towers[step[0]][-1]:
        towers[step[1]].append(towers[step[0]].pop())
        return towers
    return []


HANOI = {
    "nested": """moves = [[0,1], [0,2], [1,0], [1,2], [2,0], [2,1]];
 SELECT m1.this,  m2.this,  m3.this,  m4.this,  m5.this,  m6.this,  m7.this
 FROM   m1=moves, m2=moves, m3=moves, m4=moves, m5=moves, m6=moves, m7=moves
 WHERE  [[],[],[3,2,1]] == move(m7.this,
                             move(m6.this,
                               move(m5.this,
                                 move(m4.this,
                                   move(m3.this,
                                     move(m2.this,
                                       move(m1.this, [[3,2,1],[],[]] )))))))
 AS list;
 # result: [[0,2],[0,1],[2,1],[0,2],[1,0],[1,2],[0,2]]""",
    "cycle": """SELECT this FROM moves WHERE [[],[],[3,2,1]] == move(this, tower)

 START WITH tower = [[3,2,1],[],[]],   level=1
 CONNECT BY tower = move(this, tower), level=level+1
 STOP WITH  level==7 or []==move(this, tower);""",
    "no cycle": """SELECT this, tower FROM moves WHERE [[],[],[3,2,1]] == move(this, tower)

 START WITH tower = [[3,2,1],[],[]], level = 1
 CONNECT BY NO CYCLE # or UNIQUE
            tower = move(this, tower), level = level+1
 STOP WITH  level == 7 or [] == move(mov.this, tower);""",
    "memorize": """SELECT this, tower FROM moves WHERE [[],[],[4,3,2,1]] == move(this, tower)

 START WITH tower = [[4,3,2,1],[],[]]
 CONNECT BY MEMORIZE 15
            tower = move(this, tower)
 STOP WITH  [] == move(this, tower);""",
}
ROBOT = """ robot      = "YouBot";
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
"""
SPACE = """ # SelectScript-Example
 spheres =
   SELECT obj
   FROM space
   WHERE isSphere(this)
   AS list;
 maxMass = max(
   SELECT mass
   FROM spheres
   AS list);
 # Select 2 dimensional projections ...
 Mass    = SELECT mass FROM space WHERE hasBody(this)
           AS plane('XY', [-5,-5], [100,100,0.1], 3);
 Velocity= SELECT linearVelocity(this, 2) FROM space
           WHERE hasBody(this)
           AS plane('XY', [-5,-5], [100,100,0.1], 3);
 [Mass, Velocity];                    # return values
"""
