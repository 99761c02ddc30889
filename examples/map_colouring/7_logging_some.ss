# Logging what matters
# An IF without an else is False where its condition is not met: only colourings with a red first country are
# printed, and kept.
colours = ["red", "green", "blue", "yellow"];

SELECT a.this, b.this, c.this, d.this, e.this
FROM   a=colours, b=colours, c=colours, d=colours, e=colours
WHERE  a.this != b.this AND a.this != c.this AND a.this != d.this AND a.this != e.this AND
       b.this != c.this AND b.this != d.this AND c.this != d.this AND d.this != e.this AND
       IF(a.this == "red"; print("red:", b.this, c.this, d.this, e.this));
