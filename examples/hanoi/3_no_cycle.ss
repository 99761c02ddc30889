# NO CYCLE
# No row may occur twice on a path. The row has to say where the search stands, so SELECT names the towers too.
# The paper stops at level 7, where one path is left. Level 9 leaves 21 paths; with cycles there are 28.
moves = [[0,1], [0,2], [1,0], [1,2], [2,0], [2,1]];
SELECT this, tower FROM moves WHERE [[],[],[3,2,1]] == move(this, tower)

START WITH tower = [[3,2,1],[],[]], level = 1
CONNECT BY NO CYCLE
           tower = move(this, tower), level = level+1
STOP WITH  level == 9 or [] == move(this, tower);
