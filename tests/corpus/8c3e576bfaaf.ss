SELECT
 :  FROM  ;  ORDER BY this not_a_numberti(sh) from 