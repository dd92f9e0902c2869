//! Prints the description of the API: `station/openapi.json` is what this prints, and the page's types are made of that file.

fn main() -> Result<(), serde_json::Error> {
    println!("{}", station_core::api::openapi().to_pretty_json()?);
    Ok(())
}
