n = 1; x = print(b.this !=
d.this, n = n + 1, [1, "two"]); x;