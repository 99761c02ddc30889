# Everyone below a manager
# Level by level: BREADTH FIRST gives the nearer ones first. STOP WITH ends a path, so nobody beyond two levels is
# asked for.
SELECT name, level
FROM   (SELECT * FROM employees WHERE manager == boss)
START WITH boss = person, level = 1
CONNECT BY BREADTH FIRST boss = id, level = level + 1
STOP WITH  level > 2;
