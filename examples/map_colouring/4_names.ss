# Pairs of names
# The list holds names, as it might come from a file. eval reads the text "a.this;" in the sight of the row.
colours = ["red", "green", "blue", "yellow"];
neighbours = [["a", "b"], ["a", "c"], ["a", "d"], ["a", "e"], ["a", "f"], ["b", "c"], ["b", "d"],
              ["b", "f"], ["b", "g"], ["c", "d"], ["c", "g"], ["c", "h"], ["d", "e"], ["d", "h"],
              ["e", "f"], ["e", "h"], ["f", "g"], ["g", "h"]];

SELECT a.this, b.this, c.this, d.this, e.this, f.this, g.this, h.this
FROM   a=colours, b=colours, c=colours, d=colours, e=colours, f=colours, g=colours, h=colours
WHERE  [] == (SELECT this FROM neighbours
              WHERE eval(this[0] + ".this;") == eval(this[1] + ".this;")
              AS list);
