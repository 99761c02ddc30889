# Who leads somebody
# A query in WHERE sees the rows outside it; here it needs none of them. `manager` is a column of the inner table.
SELECT name, department
FROM   employees
WHERE  id IN (SELECT manager FROM employees AS list)
ORDER BY name;
