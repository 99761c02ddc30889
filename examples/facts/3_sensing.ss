# What is seen
# Only sensors can be asked what they sense; WHERE says so.
SELECT isSensing(a.this, b.this)
FROM   a = hall, b = hall
WHERE  isSensor(a.this) AND hasBody(b.this)
AS prolog;
