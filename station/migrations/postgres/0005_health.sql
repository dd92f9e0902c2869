-- How nodes were: one row a node and minute in which it was seen. `minute` counts from 1970; chz is a hundredth of a
-- hertz, cdb a hundredth of a decibel, ppb a thousandth of a ppm. A day of 8 anchors takes 1.4 MB.
CREATE TABLE health (
    site TEXT NOT NULL,
    node TEXT NOT NULL,
    minute INTEGER NOT NULL,
    rate_chz INTEGER NOT NULL,
    success_permille SMALLINT,
    residual_mean_mm INTEGER,
    residual_sigma_mm INTEGER,
    first_path_minus_received_cdb INTEGER,
    clock_offset_ppb INTEGER,
    supply_mv INTEGER,
    moved SMALLINT NOT NULL,
    PRIMARY KEY (site, node, minute)
);
-- By which old rows are deleted.
CREATE INDEX health_by_minute ON health (minute);
