 sum  = "one;
y = "one;= 2 2 