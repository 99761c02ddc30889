# UNIQUE
# Each row is reached once in the whole search, by the shortest way: one shortest solution at the cost of looking
# at every position once. No bound on the length is needed.
moves = [[0,1], [0,2], [1,0], [1,2], [2,0], [2,1]];
SELECT this, tower FROM moves WHERE [[],[],[3,2,1]] == move(this, tower)

START WITH tower = [[3,2,1],[],[]]
CONNECT BY UNIQUE
           tower = move(this, tower)
STOP WITH  [] == move(this, tower) or [[],[],[3,2,1]] == move(this, tower);
