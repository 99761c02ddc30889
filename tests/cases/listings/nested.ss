moves = [[0,1], [0,2], [1,0], [1,2], [2,0], [2,1]];
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
 # result: [[0,2],[0,1],[2,1],[0,2],[1,0],[1,2],[0,2]]
