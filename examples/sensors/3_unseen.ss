# Places that nobody sees
# The program has given both maps back, ss.set("seen", ...), and a script sees them as lists of lists. So their cells can
# be asked for like everything else: those that are free and that no sensor sees. Their places are in metres.
SELECT to(0.5 * column.this + 0.25, x), to(0.5 * row.this + 0.25, y)
FROM   row = range(len(seen)), column = range(len(seen[0]))
WHERE  seen[row.this, column.this] == 0 AND NOT occupied[row.this, column.this];
