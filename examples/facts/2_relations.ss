# How they stand to each other
# Calls may have several arguments, and a join gives all pairs: what stands on, or hangs over, what?
SELECT above(a.this, b.this) FROM a = hall, b = hall AS prolog;
