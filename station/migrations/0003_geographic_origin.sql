-- Where the origin of a site's frame is on the earth, and how the frame is turned: JSON.
ALTER TABLE sites ADD COLUMN geographic_origin TEXT;
