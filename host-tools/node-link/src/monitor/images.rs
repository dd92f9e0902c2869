//! The ELF files among which that of a node is: one file, or those of folders.

use std::path::{Path, PathBuf};

use super::elf::{Build, Image};
use recording::UserError;

/// Where the ELF file of a node is looked for.
#[derive(Clone, Debug)]
pub enum ImageFiles {
    /// One file, which may be built again meanwhile.
    File(PathBuf),
    /// The files `*.elf` of folders.
    Folders(Vec<PathBuf>),
}

impl ImageFiles {
    /// The image of a build, read now.
    ///
    /// # Errors
    /// There is none. The error is a sentence about what there is and what to do, which begins after "the node runs build
    /// …, ".
    pub fn find(&self, build: Build) -> Result<Image, String> {
        let mut others = Vec::new();
        for file in self.files() {
            match Image::read(&file) {
                Ok(image) if image.build == Some(build) => return Ok(image),
                Ok(image) => others.push((file, image.build)),
                // A file of something else, or one that is just being written.
                Err(_) => {}
            }
        }
        let is = |build: Option<Build>| build.map_or_else(|| "of none of ours".to_owned(), |build| build.to_string());
        Err(match (self, others.as_slice()) {
            (Self::File(file), [(_, build), ..]) => {
                let file = file.display();
                format!("the ELF file {file} is {}: flash it, or give the ELF that was flashed", is(*build))
            }
            (Self::File(file), []) => format!("the ELF file {} cannot be read now", file.display()),
            (Self::Folders(folders), others) => {
                let folders = folders.iter().filter(|folder| folder.is_dir());
                let folders: Vec<_> = folders.map(|folder| folder.display().to_string()).collect();
                let there: Vec<_> =
                    others.iter().map(|(file, build)| format!("{} {}", name(file), is(*build))).collect();
                let there = if there.is_empty() { "no ELF file".to_owned() } else { there.join(", ") };
                format!("{} has {there}: flash one, or give --elf the ELF that was flashed", folders.join(", "))
            }
        })
    }

    /// The image of a single file.
    ///
    /// # Errors
    /// As [`Image::read`].
    pub fn single(&self) -> Result<Option<Image>, UserError> {
        match self {
            Self::File(file) => Image::read(file).map(Some),
            Self::Folders(_) => Ok(None),
        }
    }

    /// The files that there are now.
    pub fn files(&self) -> Vec<PathBuf> {
        let folders = match self {
            Self::File(file) => return vec![file.clone()],
            Self::Folders(folders) => folders,
        };
        let entries = folders.iter().filter_map(|folder| std::fs::read_dir(folder).ok()).flatten().flatten();
        let mut files: Vec<_> = entries.map(|entry| entry.path()).collect();
        files.retain(|file| file.extension().is_some_and(|extension| extension == "elf"));
        files.sort();
        files
    }
}

fn name(file: &Path) -> String {
    file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
