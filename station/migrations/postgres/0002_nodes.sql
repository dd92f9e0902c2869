-- Beacons and receivers that a person has placed.
CREATE TABLE nodes (
    site TEXT NOT NULL,
    node TEXT NOT NULL,
    name TEXT,
    role TEXT NOT NULL,
    x_m DOUBLE PRECISION NOT NULL,
    y_m DOUBLE PRECISION NOT NULL,
    z_m DOUBLE PRECISION NOT NULL,
    rssi_1m_dbm DOUBLE PRECISION,
    path_loss_exponent DOUBLE PRECISION,
    PRIMARY KEY (site, node)
);
