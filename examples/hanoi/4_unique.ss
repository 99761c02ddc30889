# UNIQUE
# Each row is reached once in the whole search, by the shortest way to it. A row is a move with the towers before it,
# so the goal is reached by its two possible last moves, after seven steps and after eight. No bound is needed.
moves = [[0,1], [0,2], [1,0], [1,2], [2,0], [2,1]];
SELECT this, tower FROM moves WHERE [[],[],[3,2,1]] == move(this, tower)

START WITH tower = [[3,2,1],[],[]]
CONNECT BY UNIQUE
           tower = move(this, tower)
STOP WITH  [] == move(this, tower) or [[],[],[3,2,1]] == move(this, tower);
