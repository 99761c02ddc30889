SELECT this FROM bodies LIMIT 1 WHERE age > 40  ORDER BY THIS;
SELECT mov(this, [ } 1], [], []]) FROM  tick() ;