SELECT this, tower FROM moves WHERE [[],[],[4,3,2,1]] == move(this, tower)

 START WITH tower = [[4,3,2,1],[],[]]
 CONNECT BY MEMORIZE 15
            tower = move(this, tower)
 STOP WITH  [] == move(this, tower);
