 WHERE;
'
 ] '[1:]   n  None  name