//! What the program `baliza` reads: streams of nodes, images, files of people and of other programs.

mod documents;
mod folder;
mod streams;
mod tables;

use crate::Target;

/// All targets.
pub const TARGETS: [Target; 11] = [
    Target { name: "stream", run: streams::decoded, seeds: streams::stream_seeds },
    Target { name: "monitor", run: streams::monitored, seeds: streams::stream_seeds },
    Target { name: "elf", run: streams::elf, seeds: streams::elf_seeds },
    Target { name: "recording", run: tables::recording, seeds: tables::recording_seeds },
    Target { name: "differences", run: tables::differences, seeds: tables::difference_seeds },
    Target { name: "tables", run: tables::readers, seeds: tables::reader_seeds },
    Target { name: "receptions", run: tables::receptions, seeds: tables::reception_seeds },
    Target { name: "scenario", run: documents::scenario, seeds: documents::scenario_seeds },
    Target { name: "site", run: documents::site, seeds: documents::site_seeds },
    Target { name: "record-image", run: documents::record_image, seeds: documents::record_image_seeds },
    Target { name: "model-files", run: documents::model_files, seeds: documents::model_file_seeds },
];
