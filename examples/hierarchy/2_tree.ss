# The whole tree
# The source mentions the search's variable `boss`, so each step reads only the people who report to one person.
# Nothing stops the search but the end of the tree; every path from the top to a person is a result.
SELECT id, name
FROM   (SELECT * FROM employees WHERE manager == boss)
START WITH boss = None
CONNECT BY boss = id;
