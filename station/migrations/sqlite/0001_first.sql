-- See src/store/mod.rs for the meaning of keys and units.
CREATE TABLE tags (
    id INTEGER PRIMARY KEY,
    site TEXT NOT NULL,
    tag TEXT NOT NULL,
    first_ms INTEGER NOT NULL,
    last_ms INTEGER NOT NULL,
    UNIQUE (site, tag)
);

CREATE TABLE rooms (
    id INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE
);

CREATE TABLE recent (
    id INTEGER PRIMARY KEY,
    key INTEGER NOT NULL,
    x_mm INTEGER NOT NULL,
    y_mm INTEGER NOT NULL,
    z_mm INTEGER,
    sigma_x_mm INTEGER NOT NULL,
    sigma_y_mm INTEGER NOT NULL,
    sigma_z_mm INTEGER,
    correlation INTEGER NOT NULL,
    room INTEGER,
    used INTEGER NOT NULL
);

CREATE TABLE history (
    key INTEGER PRIMARY KEY,
    x_mm INTEGER NOT NULL,
    y_mm INTEGER NOT NULL,
    z_mm INTEGER,
    sigma_x_mm INTEGER NOT NULL,
    sigma_y_mm INTEGER NOT NULL,
    sigma_z_mm INTEGER,
    correlation INTEGER NOT NULL,
    room INTEGER,
    used INTEGER NOT NULL
);

CREATE TABLE minutes (
    minute INTEGER PRIMARY KEY,
    thinned INTEGER NOT NULL
);

CREATE TABLE events (
    id INTEGER PRIMARY KEY,
    t_us INTEGER NOT NULL,
    site TEXT NOT NULL,
    kind TEXT NOT NULL,
    node TEXT NOT NULL,
    zone TEXT,
    dwell_us INTEGER,
    alarm INTEGER NOT NULL
);
CREATE INDEX events_by_time ON events (t_us, id);

CREATE TABLE sites (
    name TEXT PRIMARY KEY,
    walls TEXT NOT NULL,
    plan TEXT,
    picture BLOB
);

CREATE TABLE zones (
    site TEXT NOT NULL,
    name TEXT NOT NULL,
    kind TEXT NOT NULL,
    corners TEXT NOT NULL,
    alarm INTEGER NOT NULL,
    PRIMARY KEY (site, name)
) WITHOUT ROWID;

CREATE TABLE campaigns (
    id INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    site TEXT NOT NULL,
    created_us INTEGER NOT NULL
);

CREATE TABLE points (
    id INTEGER PRIMARY KEY,
    campaign INTEGER NOT NULL REFERENCES campaigns (id) ON DELETE CASCADE,
    name TEXT NOT NULL,
    x_m REAL NOT NULL,
    y_m REAL NOT NULL,
    z_m REAL,
    room TEXT,
    samples INTEGER NOT NULL,
    UNIQUE (campaign, name)
);

CREATE TABLE samples (
    point INTEGER NOT NULL REFERENCES points (id) ON DELETE CASCADE,
    number INTEGER NOT NULL,
    beacon TEXT NOT NULL,
    rssi_dbm REAL NOT NULL,
    t_s REAL NOT NULL,
    PRIMARY KEY (point, number)
) WITHOUT ROWID;
