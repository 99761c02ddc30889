# A search
# START WITH gives the first state, each step takes one element of FROM, CONNECT BY makes the next state.
# WHERE marks the goal, STOP WITH ends a path. The search goes depth first and finds every path.
moves = [[0,1], [0,2], [1,0], [1,2], [2,0], [2,1]];
SELECT this FROM moves WHERE [[],[],[3,2,1]] == move(this, tower)

START WITH tower = [[3,2,1],[],[]],   level=1
CONNECT BY tower = move(this, tower), level=level+1
STOP WITH  level==7 or []==move(this, tower);
