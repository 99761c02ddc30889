# Inequalities
# One source per country, one condition per border. A condition is checked as soon as its two countries have a
# colour, so nearly all of the 65,536 combinations are never made.
colours = ["red", "green", "blue", "yellow"];

SELECT a.this, b.this, c.this, d.this, e.this, f.this, g.this, h.this
FROM   a=colours, b=colours, c=colours, d=colours, e=colours, f=colours, g=colours, h=colours
WHERE  a.this != b.this AND a.this != c.this AND a.this != d.this AND a.this != e.this AND
       a.this != f.this AND b.this != c.this AND b.this != d.this AND b.this != f.this AND
       b.this != g.this AND c.this != d.this AND c.this != g.this AND c.this != h.this AND
       d.this != e.this AND d.this != h.this AND e.this != f.this AND e.this != h.this AND
       f.this != g.this AND g.this != h.this;
