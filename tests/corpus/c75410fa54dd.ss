SELECT  false `FROM  WHERE  maximum  > 1   not  1 OFFSET ;;;
INSERT INTO people  )  (1)AS  2