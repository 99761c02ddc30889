-- Tables that cases may use, each below its name.

-- needs: flights
CREATE TABLE flights(src TEXT, dst TEXT, fare INTEGER, leaves INTEGER, arrives INTEGER);
CREATE INDEX flights_by_src ON flights(src);
INSERT INTO flights VALUES ('a', 'b', 50, 1, 2), ('b', 'c', 40, 3, 5), ('a', 'c', 120, 2, 4),
    ('c', 'a', 30, 6, 7), ('b', 'd', 200, 2, 3), ('c', 'd', 60, 5, 6), ('d', 'b', 10, 7, 8),
    ('b', 'c', 90, 1, 2), ('e', 'a', 5, 1, 2);

-- needs: tasks
CREATE TABLE tasks(task TEXT, needs TEXT);
INSERT INTO tasks VALUES ('plan', NULL), ('dig', 'plan'), ('wall', 'dig'), ('roof', 'wall'), ('pipe', 'dig'),
    ('paint', 'wall'), ('paint', 'pipe'), ('roof', 'pipe');

-- needs: employees
CREATE TABLE employees(id INTEGER PRIMARY KEY, name TEXT, boss INTEGER, salary REAL);
INSERT INTO employees VALUES (1, 'Mary', NULL, 9000), (2, 'Kim', 1, 5000.5), (3, 'Lee', 1, NULL),
    (4, 'Ann', 2, 4000), (5, 'Bob', 2, 4000), (6, 'Eve', 4, 3000);

-- needs: words
CREATE TABLE words(word TEXT COLLATE NOCASE, number INTEGER);
INSERT INTO words VALUES ('Tree', 1), ('tree', 2), ('TREE', 3), ('house', 4);

-- needs: mixed
CREATE TABLE mixed(value INTEGER);
INSERT INTO mixed VALUES (10), ('ten'), (NULL), (2.5), ('9');

-- needs: codes
CREATE TABLE codes(code TEXT PRIMARY KEY, meaning TEXT) WITHOUT ROWID;
INSERT INTO codes VALUES ('b', 'second'), ('a', 'first'), ('c', NULL);

-- needs: bosses
CREATE TABLE staff(name TEXT, boss TEXT);
INSERT INTO staff VALUES ('Mary', NULL), ('Kim', 'Mary'), ('Ann', 'Kim'), ('Lee', 'Mary');
CREATE VIEW bosses AS SELECT boss AS name, count(*) AS reports FROM staff WHERE boss IS NOT NULL
    GROUP BY boss ORDER BY boss DESC;

-- needs: order
CREATE TABLE "order"("group" TEXT, "index" INTEGER, "select" TEXT);
INSERT INTO "order" VALUES ('x', 1, 'p'), ('y', 2, 'q');

-- needs: roads
CREATE TABLE roads(src TEXT, dst TEXT, length INTEGER);
INSERT INTO roads VALUES ('a', 'd', 9), ('a', 'b', 2), ('b', 'd', 5), ('b', 'c', 1), ('c', 'd', 2);

-- needs: sizes
CREATE TABLE parts(part TEXT, width REAL);
INSERT INTO parts VALUES ('bolt', -2.25), ('nut', 2.6);
CREATE VIEW sizes AS SELECT part, CAST(round(abs(width)) AS INTEGER) AS size FROM parts;

-- needs: oddities
CREATE TABLE kinds(a, b INTEGER, c REAL, d TEXT);
INSERT INTO kinds VALUES (1, 'one', 2, 3), (1.5, 2.5, 'x', NULL), ('a', NULL, 4.0, 'd'), (x'00ff', 1, 1, 1);
CREATE TABLE digits(number INTEGER, word TEXT);
INSERT INTO digits VALUES (1, '1'), (2, '2');
CREATE TABLE spellings(a TEXT COLLATE NOCASE PRIMARY KEY, b TEXT COLLATE RTRIM);
INSERT INTO spellings VALUES ('b', 'x '), ('A', 'x'), ('C', 'y');
CREATE TABLE keyed(key INTEGER PRIMARY KEY, a);
INSERT INTO keyed VALUES (3, 'x'), (1, 'y'), (2, 'x');
CREATE INDEX by_a ON keyed(a);
CREATE VIEW turned AS SELECT a FROM keyed ORDER BY key DESC;
CREATE TABLE numbered(rowid, Oid, a);
INSERT INTO numbered VALUES ('z', 9, 1), ('y', 8, 2);
CREATE TABLE renumbered(rowid, oid, _rowid_);
INSERT INTO renumbered VALUES (3, 2, 1), (1, 2, 3);
CREATE TABLE generated(a INTEGER, double INTEGER AS (2 * a), stored TEXT AS (a || '!') STORED) STRICT;
INSERT INTO generated(a) VALUES (1), (2);
CREATE TABLE nobody(a, b);

-- needs: unreadable
CREATE TABLE spoilt(i INTEGER, a TEXT);
INSERT INTO spoilt VALUES (1, 'ann'), (2, CAST(x'4dfc6c' AS TEXT)), (3, CAST(x'4dfc6c' AS TEXT)), (4, 'bob');
CREATE TABLE spoilt_number(i INTEGER, a);
INSERT INTO spoilt_number VALUES (1, 2), (2, CAST(x'ff' AS TEXT));
CREATE VIEW blobs AS SELECT CAST(a AS BLOB) AS a FROM spoilt;

-- needs: infinite
CREATE TABLE infinite(a REAL);
INSERT INTO infinite VALUES (1.5), (9e999), (NULL);
CREATE TABLE infinite_or_text AS SELECT a FROM infinite UNION ALL SELECT 'x';
CREATE VIEW infinite_seen AS SELECT 1.5 AS a UNION ALL SELECT -9e999;

-- needs: broken
CREATE TABLE gone(part TEXT);
CREATE VIEW broken AS SELECT part FROM gone;
DROP TABLE gone;

-- needs: pairs
CREATE TABLE pairs(a INTEGER, b INTEGER);
INSERT INTO pairs VALUES (1, 2), (2, 3);
CREATE VIEW seen AS SELECT * FROM pairs;

-- needs: big
CREATE TABLE big(a INTEGER);
INSERT INTO big VALUES (9007199254740993), (1);

-- needs: ways
CREATE TABLE ways(start, position);
INSERT INTO ways VALUES (1, 2), (2, 3), (1, 3), (3, 4);

-- needs: forms
CREATE TABLE forms(src, dst);
INSERT INTO forms VALUES (0, 1.0), (0, 1), (1, NULL), (NULL, '1');

-- needs: indexed
CREATE TABLE indexed(src INTEGER, dst INTEGER, length INTEGER);
CREATE INDEX by_src ON indexed(src);
INSERT INTO indexed VALUES (1, 2, 5), (2, 3, 4), (7, 8, 0), (20, 21, 1), (21, 22, 1), (21, 29, 1),
    (22, 23, 1), (23, 24, 1);

-- needs: days
CREATE TABLE days(day DATE, n);
INSERT INTO days VALUES ('2020-01-01', 1), ('2021-01-01', 2), ('2020-03', 3);

-- needs: departments
CREATE TABLE emp(id INTEGER PRIMARY KEY, dept INTEGER, name TEXT);
INSERT INTO emp VALUES (1, 3, 'c'), (2, 1, 'a'), (3, 2, 'b');
CREATE TABLE pay(dept INTEGER, sum INTEGER);
INSERT INTO pay VALUES (1, 5), (2, 5), (3, 5);
CREATE VIEW rich AS SELECT dept, sum FROM pay WHERE sum > 3;
CREATE INDEX by_dept ON emp(dept);
