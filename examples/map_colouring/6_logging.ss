# Logging on the way
# print gives back its last argument, which is true here, so it can stand anywhere in a condition. The query keeps
# the written order: one line for each of the 1,024 combinations.
colours = ["red", "green", "blue", "yellow"];
n = 0;

SELECT a.this, b.this, c.this, d.this, e.this
FROM   a=colours, b=colours, c=colours, d=colours, e=colours
WHERE  print("log:", n = n + 1, a.this, b.this, c.this, d.this, e.this) AND
       a.this != b.this AND a.this != c.this AND a.this != d.this AND a.this != e.this AND
       b.this != c.this AND b.this != d.this AND c.this != d.this AND d.this != e.this;
