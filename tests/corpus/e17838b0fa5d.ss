Select  '{'  AS   '' ()  SELECT city , age FROM people;;
x = [1]; y = grow( { ); [x, y, grow([7 == y];