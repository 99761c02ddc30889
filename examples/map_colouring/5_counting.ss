# Counting on the way
# Five countries. IF runs one of two branches; its last value is the answer. The variables count both outcomes.
colours = ["red", "green", "blue", "yellow"];
positive = 0;
negative = 0;

SELECT a.this, b.this, c.this, d.this, e.this
FROM   a=colours, b=colours, c=colours, d=colours, e=colours
WHERE  IF(a.this != b.this AND a.this != c.this AND a.this != d.this AND a.this != e.this AND
          b.this != c.this AND b.this != d.this AND c.this != d.this AND d.this != e.this;
          positive = positive + 1, True;
          negative = negative + 1, False)
AS void;

[positive, negative];
