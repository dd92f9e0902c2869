-- See src/store/mod.rs for the meaning of keys and units.
CREATE TABLE tags (
    id BIGINT PRIMARY KEY,
    site TEXT NOT NULL,
    tag TEXT NOT NULL,
    first_ms BIGINT NOT NULL,
    last_ms BIGINT NOT NULL,
    UNIQUE (site, tag)
);

CREATE TABLE rooms (
    id INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE
);

CREATE TABLE recent (
    id BIGINT GENERATED ALWAYS AS IDENTITY,
    key BIGINT NOT NULL,
    x_mm INTEGER NOT NULL,
    y_mm INTEGER NOT NULL,
    z_mm INTEGER,
    sigma_x_mm INTEGER NOT NULL,
    sigma_y_mm INTEGER NOT NULL,
    sigma_z_mm INTEGER,
    correlation SMALLINT NOT NULL,
    room INTEGER,
    used SMALLINT NOT NULL
);

CREATE TABLE history (
    key BIGINT PRIMARY KEY,
    x_mm INTEGER NOT NULL,
    y_mm INTEGER NOT NULL,
    z_mm INTEGER,
    sigma_x_mm INTEGER NOT NULL,
    sigma_y_mm INTEGER NOT NULL,
    sigma_z_mm INTEGER,
    correlation SMALLINT NOT NULL,
    room INTEGER,
    used SMALLINT NOT NULL
);

CREATE TABLE minutes (
    minute BIGINT PRIMARY KEY,
    thinned SMALLINT NOT NULL
);

CREATE TABLE events (
    id BIGINT PRIMARY KEY,
    t_us BIGINT NOT NULL,
    site TEXT NOT NULL,
    kind TEXT NOT NULL,
    node TEXT NOT NULL,
    zone TEXT,
    dwell_us BIGINT,
    alarm SMALLINT NOT NULL
);
CREATE INDEX events_by_time ON events (t_us, id);

CREATE TABLE sites (
    name TEXT PRIMARY KEY,
    walls TEXT NOT NULL,
    plan TEXT,
    picture BYTEA
);

CREATE TABLE zones (
    site TEXT NOT NULL,
    name TEXT NOT NULL,
    kind TEXT NOT NULL,
    corners TEXT NOT NULL,
    alarm SMALLINT NOT NULL,
    PRIMARY KEY (site, name)
);

CREATE TABLE campaigns (
    id INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    site TEXT NOT NULL,
    created_us BIGINT NOT NULL
);

CREATE TABLE points (
    id INTEGER PRIMARY KEY,
    campaign INTEGER NOT NULL REFERENCES campaigns (id) ON DELETE CASCADE,
    name TEXT NOT NULL,
    x_m DOUBLE PRECISION NOT NULL,
    y_m DOUBLE PRECISION NOT NULL,
    z_m DOUBLE PRECISION,
    room TEXT,
    samples BIGINT NOT NULL,
    UNIQUE (campaign, name)
);

CREATE TABLE samples (
    point INTEGER NOT NULL REFERENCES points (id) ON DELETE CASCADE,
    number BIGINT NOT NULL,
    beacon TEXT NOT NULL,
    rssi_dbm DOUBLE PRECISION NOT NULL,
    t_s DOUBLE PRECISION NOT NULL,
    PRIMARY KEY (point, number)
);
