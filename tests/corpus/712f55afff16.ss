SELECT  columns 
FROM people
WHERE age > 40
 !=  name IN SELECT name
FROM people
WHERE city == "London"
+ 1;