//! Sites, scenarios, images of records, files of models.

use std::path::Path;

use analysis::survey::rooms::ModelFile;
use analysis::train::Chosen;
use node_link::provision::image::RecordImage;
use node_link::provision::show::{self, Keys};
use node_link::provision::{EXAMPLE, Site, SiteNames, oddities, site_models, warnings};
use sim::scenario::Scenario;
use wire::config::{Board, Wifi};

use super::folder;

/// The shortest site that can be simulated, with a path and a fault.
const SHORTEST: &[u8] = b"[[node]]\nrole = \"anchor\"\nposition_m = [0, 0, 2]\n\
    [[node]]\nrole = \"tag\"\nsimulation = { path_m = [[1, 2, 1]] }\n\
    [[simulation.fault]]\nat_s = 1\nnode = 1\nwhat = \"off\"\n";

pub fn scenario(input: &[u8]) {
    let Ok(text) = std::str::from_utf8(input) else { return };
    if let Err(error) = Scenario::parse(text) {
        assert!(error.line != Some(0) && !error.message.is_empty() && !error.message.contains('\n'), "{error}");
    }
}

pub fn scenario_seeds() -> Vec<Vec<u8>> {
    let every_key = include_bytes!("../../../../examples/every-key.toml");
    vec![every_key.to_vec(), SHORTEST.to_vec(), EXAMPLE.as_bytes().to_vec()]
}

pub fn site(input: &[u8]) {
    let Ok(text) = std::str::from_utf8(input) else { return };
    match Site::parse(Path::new("nowhere/site.toml"), text) {
        Ok(site) => {
            assert!(site.nodes.iter().all(|node| node.record.validate().is_ok()));
            assert!(warnings(&site.nodes).into_iter().chain(oddities(&site)).all(|line| !line.contains('\n')));
        }
        Err(error) => assert!(!error.to_string().contains('\n'), "{error}"),
    }
}

pub fn site_seeds() -> Vec<Vec<u8>> {
    let tag = include_bytes!("../../../../examples/sites/rotating-beacon.toml");
    let receiver = b"[[receiver]]\nname = \"hall\"\nposition_m = [0, 0, 2]\npath_loss_exponent = 2.2\n";
    vec![EXAMPLE.as_bytes().to_vec(), tag.to_vec(), receiver.to_vec()]
}

/// A record that is shown can be provisioned again, unless everyone knows its key.
pub fn record_image(input: &[u8]) {
    let Ok(image) = RecordImage::new(input) else { return };
    let _ = image.check();
    let Ok(held) = image.read() else { return };
    let names = SiteNames::default();
    let _ = (held.classifier(), held.map_and_rooms(), show::summary(&held));
    let _ = show::json(&held, None, Keys::Hidden, &names);
    let shown = show::toml(&held, None, Keys::Shown, &names);
    if let Err(error) = Site::parse(Path::new("site.toml"), &shown) {
        // A page may have settings of Wi-Fi beside any record.
        let error = error.to_string();
        assert!(error.contains("beacon_key") || error.contains("wifi"), "{error}\n{shown}");
    }
}

pub fn record_image_seeds() -> Vec<Vec<u8>> {
    let site = Site::parse(Path::new("site.toml"), EXAMPLE).expect("the example is right");
    let contents = |node: &node_link::provision::Node| {
        let wifi = Wifi {
            ssid: "a \"b\"".parse().expect("short"),
            password: "c\\defghi".parse().expect("short"),
            host: "nas".parse().expect("short"),
            port: 7000,
            key: None,
        };
        let (record, wifi) = (&node.record, Some(&wifi));
        let contents = node_link::provision::image::Contents { record, model: None, site_models: None, wifi };
        [contents.binary(Board::Dwm1001), contents.intel_hex(Board::Dwm1001).expect("Intel HEX").into_bytes()]
    };
    site.nodes.iter().skip(3).flat_map(contents).collect()
}

pub fn model_files(input: &[u8]) {
    let file = folder::file("model", input);
    let _ = (Chosen::read(&file, None), ModelFile::parse(input));
    let _ = (site_models::read_map(&file), site_models::read_rooms(&file));
}

pub fn model_file_seeds() -> Vec<Vec<u8>> {
    let map = include_bytes!("../../../../examples/fingerprints.map");
    let rooms = include_bytes!("../../../../examples/fingerprints.rooms");
    vec![map.to_vec(), rooms.to_vec()]
}
