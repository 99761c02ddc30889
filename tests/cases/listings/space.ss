 # SelectScript-Example
 spheres =
   SELECT obj
   FROM space
   WHERE isSphere(this)
   AS list;
 maxMass = max(
   SELECT mass
   FROM spheres
   AS list);
 # Select 2 dimensional projections ...
 Mass    = SELECT mass FROM space WHERE hasBody(this)
           AS plane('XY', [-5,-5], [100,100,0.1], 3);
 Velocity= SELECT linearVelocity(this, 2) FROM space
           WHERE hasBody(this)
           AS plane('XY', [-5,-5], [100,100,0.1], 3);
 [Mass, Velocity];                    # return values
