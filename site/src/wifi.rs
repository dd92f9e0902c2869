//! `[wifi]`: the Wi-Fi of a site, and the station that its nodes with Wi-Fi reach.

use std::path::PathBuf;

use serde::Deserialize;
use wire::config::{Invalid, Wifi};

use crate::document::{KeyLines, SiteError};
use crate::network::HIDDEN;

/// `[wifi]`.
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct WifiTable {
    ssid: String,
    #[serde(default)]
    password: String,
    station: String,
    pub(crate) gateways: Option<PathBuf>,
}

impl WifiTable {
    /// The settings of a node, without its key.
    pub(crate) fn settings(&self, lines: &KeyLines) -> Result<Wifi, SiteError> {
        let wrong = |key: &str, what: String| SiteError::at(lines.of(key), what);
        if self.password == HIDDEN {
            let what = "password is hidden: put the password there, or show the record with --show-keys";
            return Err(wrong("password", what.to_owned()));
        }
        let station = || {
            let what = "must be a name or an IPv4 address and a port, as 192.168.1.20:7000";
            wrong("station", format!("station is {:?}: it {what}", self.station))
        };
        let (host, port) = self.station.rsplit_once(':').ok_or_else(station)?;
        let wifi = Wifi {
            ssid: self.ssid.parse().map_err(|_| wrong("ssid", "ssid has more than 32 bytes".to_owned()))?,
            password: self
                .password
                .parse()
                .map_err(|_| wrong("password", "password has more than 63 characters".to_owned()))?,
            host: host.parse().map_err(|_| station())?,
            port: port.parse().map_err(|_| station())?,
            key: None,
        };
        wifi.validate().map(|()| wifi).map_err(|Invalid { field, value, must, .. }| match field {
            "wifi.ssid" => wrong("ssid", format!("ssid has {value} bytes: it must have {must}")),
            "wifi.password" => wrong("password", format!("password has {value} characters: it must have {must}")),
            _ => station(),
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::{Purpose, Site};

    fn site(wifi: &str, node: &str) -> Result<Site, String> {
        let text = format!(
            "[network]\npan = 0xBA12\nregion = \"eu\"\n[wifi]\n{wifi}\n[[node]]\nname = \"a\"\nrole = \"anchor\"\n{node}"
        );
        Site::parse(&text, Purpose::Nodes).map_err(|error| error.to_string())
    }

    const HALL: &str = "ssid = \"hall\"\npassword = \"correct horse\"\nstation = \"192.168.1.20:7000\"";

    #[test]
    fn nodes_with_wifi_have_the_sites_settings_and_others_none() {
        let of = |node| site(HALL, node).expect("a site").nodes[0].wifi.clone();
        let wifi = of("board = \"esp32c3\"\nwifi = true").expect("settings");
        assert_eq!(
            (&*wifi.ssid, &*wifi.password, &*wifi.host, wifi.port),
            ("hall", "correct horse", "192.168.1.20", 7000)
        );
        assert_eq!(of("board = \"esp32c3\""), None);
        assert_eq!(
            site(&format!("{HALL}\ngateways = \"g.toml\""), "").expect("a site").gateways,
            Some("g.toml".into())
        );
    }

    #[test]
    fn what_cannot_be_used_is_told_with_its_line_and_without_the_password() {
        let refused = |wifi: &str, node: &str| site(wifi, node).expect_err(wifi);
        let esp = "board = \"esp32c3\"\nwifi = true";
        for (from, to, expected) in [
            ("\"hall\"", "\"\"", "line 5: ssid has 0 bytes: it must have 1 to 32 bytes"),
            ("\"hall\"", "\"123456789012345678901234567890123\"", "line 5: ssid has more than 32 bytes"),
            (
                "correct horse",
                "horse",
                "line 6: password has 5 characters: it must have 8 to 63 letters, digits and signs of ASCII",
            ),
            (
                "correct horse",
                "hidden",
                "line 6: password is hidden: put the password there, or show the record with --show-keys",
            ),
            (
                ":7000",
                "",
                "line 7: station is \"192.168.1.20\": it must be a name or an IPv4 address and a port, as 192.168.1.20:7000",
            ),
            (
                ":7000",
                ":0",
                "line 7: station is \"192.168.1.20:0\": it must be a name or an IPv4 address and a port, as 192.168.1.20:7000",
            ),
        ] {
            assert_eq!(refused(&HALL.replace(from, to), esp), expected);
        }
        assert!(refused(&HALL.replace("ssid", "sid"), esp).contains("unknown key sid"));
        assert_eq!(refused(HALL, "board = \"dwm1001\"\nwifi = true"), "line 12: wifi is true: a dwm1001 has no Wi-Fi");
        let without = "[network]\npan = 1\nregion = \"eu\"\n[[node]]\nrole = \"anchor\"\nwifi = true\n";
        let error = Site::parse(without, Purpose::Nodes).expect_err("no table").to_string();
        assert_eq!(error, "line 6: wifi is true: [wifi] with ssid and station is missing");
        let scanning = "[network]\npan = 1\nregion = \"eu\"\n[wifi]\nssid = \"a\"\nstation = \"b:1\"\n[[node]]\nrole = \"tag\"\nwifi = true\nscan_interval_ms = 100\n";
        let error = Site::parse(scanning, Purpose::Nodes).expect_err("both").to_string();
        assert_eq!(error, "line 9: wifi with scan_interval_ms: the image with Wi-Fi has no Bluetooth");
    }
}
