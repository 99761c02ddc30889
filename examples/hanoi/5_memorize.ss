# MEMORIZE, four disks
# The graph of rows is built first, at most 18 steps deep; then come the paths without a repeated row,
# shortest first. The paper writes MEMORIZE 15, which leaves the one path of fifteen moves.
moves = [[0,1], [0,2], [1,0], [1,2], [2,0], [2,1]];
SELECT this, tower FROM moves WHERE [[],[],[4,3,2,1]] == move(this, tower)

START WITH tower = [[4,3,2,1],[],[]]
CONNECT BY MEMORIZE 18
           tower = move(this, tower)
STOP WITH  [] == move(this, tower);
