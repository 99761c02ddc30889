# Who sees the robot?
# This script is a trigger: the program registers it, and while the robot drives, it runs every tenth of a second of
# the simulation's time. A Python function hears of it whenever the answer has changed.
SELECT name FROM hall WHERE isSensor(this) AND isSensing(this, "YouBot") AS list;
