# The fewest converters
# Data formats are states, converters are steps: each leads from the format that it takes to the one that it gives. A
# source that mentions the state is read anew for each state. UNIQUE goes breadth first, so the first chain is shortest.
have = "csv";
want = "numpy";

SELECT name, price
FROM   (SELECT * FROM library WHERE takes == format)
WHERE  gives == want

START WITH format = have
CONNECT BY UNIQUE MAXIMUM 1
           format = gives
STOP WITH  gives == want;
