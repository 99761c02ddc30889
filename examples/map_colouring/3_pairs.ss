# Pairs in a variable
# The list of pairs has a name. Its elements mention a.this, so it is read again for each row of the query that
# has a source a.
colours = ["red", "green", "blue", "yellow"];
neighbours = [[a.this, b.this], [a.this, c.this], [a.this, d.this], [a.this, e.this],
              [a.this, f.this], [b.this, c.this], [b.this, d.this], [b.this, f.this],
              [b.this, g.this], [c.this, d.this], [c.this, g.this], [c.this, h.this],
              [d.this, e.this], [d.this, h.this], [e.this, f.this], [e.this, h.this],
              [f.this, g.this], [g.this, h.this]];

SELECT a.this, b.this, c.this, d.this, e.this, f.this, g.this, h.this
FROM   a=colours, b=colours, c=colours, d=colours, e=colours, f=colours, g=colours, h=colours
WHERE  [] == (SELECT this FROM neighbours WHERE this[0] == this[1] AS list);
