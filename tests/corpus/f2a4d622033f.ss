] from [ <> SELECT t ] True  2  start    CONNECT BY UNIQUE 1.  ;  n =  xor 
n = n + 1;