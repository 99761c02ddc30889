# A nested query
# The borders are a list of pairs of colours, and no pair may hold the same colour twice: the query that looks
# for such pairs finds nothing.
colours = ["red", "green", "blue", "yellow"];

SELECT a.this, b.this, c.this, d.this, e.this, f.this, g.this, h.this
FROM   a=colours, b=colours, c=colours, d=colours, e=colours, f=colours, g=colours, h=colours
WHERE  [] == (SELECT this
              FROM [[a.this, b.this], [a.this, c.this], [a.this, d.this],
                    [a.this, e.this], [a.this, f.this], [b.this, c.this],
                    [b.this, d.this], [b.this, f.this], [b.this, g.this],
                    [c.this, d.this], [c.this, g.this], [c.this, h.this],
                    [d.this, e.this], [d.this, h.this], [e.this, f.this],
                    [e.this, h.this], [f.this, g.this], [g.this, h.this]]
              WHERE this[0] == this[1]
              AS list);
