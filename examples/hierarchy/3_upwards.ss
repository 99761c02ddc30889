# Who reports to whom
# The same table read the other way: from one person up to the one who has no manager. `person` is a parameter.
SELECT name, department
FROM   (SELECT * FROM employees WHERE id == current)
WHERE  manager == None
START WITH current = person
CONNECT BY current = manager;
