SELECT name FROM people LIMIT
SELECT
this FROM [1] STOP WITH this == 1;