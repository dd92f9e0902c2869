-- What makes a position doubtful: "suspect", or the other of two places in millimetres, "X Y Z". Null: nothing.
ALTER TABLE recent ADD COLUMN doubt TEXT;
ALTER TABLE history ADD COLUMN doubt TEXT;
