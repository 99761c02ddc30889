"""Names that virtual tables of worlds and the SQL that reads them have in common."""

PLACE = "place in the walk"  # a hidden column; the blanks keep it apart from the names of users
