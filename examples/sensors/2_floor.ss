# Where something stands
# The same map of what is occupied: all bodies but the robot and the sensors, at a height of 10 cm.
SELECT obj FROM hall WHERE NOT isRobot(this) AND NOT isSensor(this) AS occupancygrid(0.1, 0.5);
