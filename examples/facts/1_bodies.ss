# What the bodies are
# AS prolog writes every call in SELECT as a fact. True stands without a value, isSensor(sensor_1); what is False is no
# fact. Bodies have their names.
SELECT isSensor, isRobot, mass
FROM   hall
WHERE  isSensor(this) OR hasBody(this)
AS prolog;
