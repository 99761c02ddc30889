# Before and after
# A query sees the world as it is when it is read. This one runs twice, with two seconds of simulation in between:
# spheres multiply, because hard collisions make bodies explode into small ones.
SELECT type, count(this), to(round(sum(mass)), kg), to(round(max(norm(velocity)), 1), fastest)
FROM space
WHERE hasBody(this)
GROUP BY type;
