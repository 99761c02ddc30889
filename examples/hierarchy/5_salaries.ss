# Salaries by department
# GROUP BY with group values and aggregates only gives one row per group.
SELECT department, to(count(*), people), to(min(salary), lowest), to(round(average(salary)), mean), to(max(salary), highest)
FROM   employees
GROUP BY department
ORDER BY average(salary) DESC;
