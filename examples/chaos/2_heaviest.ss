# The heaviest sphere
# The paper's listing, and its last step: obj is the body itself, so the list of spheres is a source in its turn, and
# what comes out can be given to the simulator, or to the one who draws it.
spheres =
  SELECT obj
  FROM space
  WHERE isSphere(this)
  AS list;
maxMass = max(
  SELECT mass
  FROM spheres
  AS list);

SELECT id, name, mass FROM spheres WHERE mass(this) == maxMass;
