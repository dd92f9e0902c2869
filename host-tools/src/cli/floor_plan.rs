//! `--walls` and `--plan`: what a picture has beneath the positions.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use pictures::{Image, Plan};
use recording::UserError;
use recording::beacons::{Wall, read_walls};
use recording::{IMAGE_BYTES, read_limited};

use super::numbers::finite;

/// The flags of a floor plan.
#[derive(clap::Args)]
pub struct FloorPlanArgs {
    /// Walls, which are drawn: CSV with the corners of an outline, x_m,y_m, or with x1_m,y1_m,x2_m,y2_m
    #[arg(long, value_name = "FILE")]
    walls: Option<PathBuf>,
    /// An image of the floor plan, which is drawn beneath: .png or .jpg, x to the right and y up
    #[arg(long, value_name = "FILE", requires = "plan_scale")]
    plan: Option<PathBuf>,
    /// Metres of a pixel of the plan
    #[arg(long, value_name = "METRES", value_parser = scale, requires = "plan")]
    plan_scale: Option<f64>,
    /// Where the plan's lower left corner is, metres
    #[arg(long, value_name = "X,Y", default_value = "0,0", allow_hyphen_values = true, value_parser = Corner::parse, requires = "plan")]
    plan_corner: Corner,
}

/// `--plan-corner`.
#[derive(Clone, Copy, Debug)]
struct Corner([f64; 2]);

impl Corner {
    fn parse(text: &str) -> Result<Self, String> {
        let numbers = text.split(',').map(finite).collect::<Result<Vec<_>, _>>()?;
        match numbers[..] {
            [x, y] => Ok(Self([x, y])),
            _ => Err("two numbers are expected: X,Y".to_owned()),
        }
    }
}

fn scale(text: &str) -> Result<f64, String> {
    match finite(text)? {
        metres if (1e-6..=1e6).contains(&metres) => Ok(metres),
        _ => Err("it must be from 0.000001 to 1000000".to_owned()),
    }
}

/// What a picture has beneath the positions.
#[derive(Clone, Debug, Default)]
pub struct FloorPlan {
    /// Both ends of every wall, metres.
    pub walls_m: Vec<[[f64; 2]; 2]>,
    /// The image.
    pub plan: Option<Plan>,
}

impl FloorPlan {
    /// Walls without an image.
    pub fn of_walls(walls: &[Wall]) -> Self {
        Self { walls_m: walls.iter().map(|wall| wall.ends_m).collect(), plan: None }
    }
}

impl FloorPlanArgs {
    /// Reads the files; without `--walls`, `walls` are read where they are given.
    ///
    /// # Errors
    /// The first line that is wrong, or the plan is no image.
    pub fn read(&self, walls: Option<&Path>) -> Result<FloorPlan, UserError> {
        let walls = self.walls.as_deref().or(walls).map(read_walls).transpose()?.unwrap_or_default();
        let plan = match (&self.plan, self.plan_scale) {
            (Some(file), Some(metres)) => Some(image(file, metres, self.plan_corner.0)?),
            (_, _) => None,
        };
        Ok(FloorPlan { plan, ..FloorPlan::of_walls(&walls) })
    }
}

fn image(file: &Path, metres: f64, [x, y]: [f64; 2]) -> Result<Plan, UserError> {
    let image =
        Image::read(read_limited(file, IMAGE_BYTES)?).map_err(|error| UserError::file(file, error.to_string()))?;
    let [wide, high] = image.size().map(|pixels| metres * pixels as f64);
    Ok(Plan { image: Arc::new(image), corners_m: [[x, y], [x + wide, y + high]] })
}
