-- Beacons and receivers that a person has placed.
CREATE TABLE nodes (
    site TEXT NOT NULL,
    node TEXT NOT NULL,
    name TEXT,
    role TEXT NOT NULL,
    x_m REAL NOT NULL,
    y_m REAL NOT NULL,
    z_m REAL NOT NULL,
    rssi_1m_dbm REAL,
    path_loss_exponent REAL,
    PRIMARY KEY (site, node)
) WITHOUT ROWID;
