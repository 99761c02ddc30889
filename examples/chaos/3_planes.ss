# Two planes
# The paper's listing: AS plane adds up what is selected over a grid of 100 x 100 cells of 10 cm, seen from above, and
# blurs it over 3 cells. What comes out are NumPy arrays; below, a letter stands for 2 x 4 of their cells.
 # Select 2 dimensional projections ...
 Mass    = SELECT mass FROM space WHERE hasBody(this)
           AS plane('XY', [-5,-5], [100,100,0.1], 3);
 Velocity= SELECT linearVelocity(this, 2) FROM space
           WHERE hasBody(this)
           AS plane('XY', [-5,-5], [100,100,0.1], 3);
 [Mass, Velocity];                    # return values
