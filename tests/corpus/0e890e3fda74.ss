 CONNECT BY p  '{'  p + this   xor   CONNECT
BY
NO  as  MEMORIZE 3 p = this  n = >  [1, 2];