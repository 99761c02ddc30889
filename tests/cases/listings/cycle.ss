SELECT this FROM moves WHERE [[],[],[3,2,1]] == move(this, tower)

 START WITH tower = [[3,2,1],[],[]],   level=1
 CONNECT BY tower = move(this, tower), level=level+1
 STOP WITH  level==7 or []==move(this, tower);
