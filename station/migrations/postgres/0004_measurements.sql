-- Nodes that were measured to, and where they were when last reported.
CREATE TABLE peers (
    id BIGINT PRIMARY KEY,
    site TEXT NOT NULL,
    node TEXT NOT NULL,
    role TEXT,
    x_mm INTEGER,
    y_mm INTEGER,
    z_mm INTEGER,
    rssi_1m_cdbm INTEGER,
    path_loss_exponent_milli INTEGER,
    UNIQUE (site, node)
);

-- Ranges, and sightings: they have no range, and their power is the RSSI.
CREATE TABLE measurements (
    key BIGINT NOT NULL,
    peer BIGINT NOT NULL,
    before_ms INTEGER NOT NULL,
    range_mm INTEGER,
    power_cdbm INTEGER,
    first_path_power_cdbm INTEGER,
    clock_offset_ppb INTEGER,
    PRIMARY KEY (key, peer, before_ms)
);
