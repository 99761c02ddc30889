# What the sensors see
# AS sensorgrid makes a map of the selected sensors: how many of them see each cell, here cells of half a metre on the
# floor. It follows rays, so machines and walls hide what is behind them. AS sensormap is the same.
SELECT obj FROM hall WHERE isSensor(this) AS sensorgrid(0.01, 0.5);
