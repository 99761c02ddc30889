# The cheapest chain
# One word more, COST, and it is the sum of prices that counts, not the number of converters.
have = "csv";
want = "numpy";

SELECT name, price
FROM   (SELECT * FROM library WHERE takes == format)
WHERE  gives == want

START WITH format = have
CONNECT BY COST price UNIQUE MAXIMUM 1
           format = gives
STOP WITH  gives == want;
