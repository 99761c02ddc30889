# Heavy spheres
# A world is a table: FROM walks its bodies, and each column is also a function of a body, so that mass and mass(this)
# are one thing. Only bodies that are spheres are asked for their mass.
SELECT mass, pos FROM space WHERE isSphere(this) AND mass(this) > 50;
