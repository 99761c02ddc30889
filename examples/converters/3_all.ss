# Everything that can be reached
# Without a goal every chain is a result, and UNIQUE keeps the cheapest to each format: this is what the library can make
# of a text in CSV. What leads back to CSV stops, and leaves no trace.
have = "csv";

SELECT gives
FROM   (SELECT * FROM library WHERE takes == format)

START WITH format = have
CONNECT BY COST price UNIQUE
           format = gives
STOP WITH  gives == have
AS list;
