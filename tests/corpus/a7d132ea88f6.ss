in
   