//! Our figures beside those of the thesis, as a Markdown table.

use std::fmt::Write as _;

use positioning_core::Method;

use super::ThesisScore;
use super::printed::{DDP_ANCHORS, printed};

/// Root mean square errors by method and number of detected direct paths, one row ours and one row as printed.
pub fn to_markdown(scores: &[ThesisScore]) -> String {
    let classes = || std::iter::once(None).chain(DDP_ANCHORS.map(Some));
    let mut text = String::from("| RMSE in metres |   all |");
    for number in DDP_ANCHORS {
        let _ = write!(text, " {:>5} |", format!("{number} DDP"));
    }
    text += "\n|----------------|------:|";
    text += &"------:|".repeat(DDP_ANCHORS.count());
    for method in Method::ALL {
        let name = method.as_str();
        let ours = |class| {
            scores
                .iter()
                .find(|score| score.method == name && score.ddp_anchors == class)
                .and_then(|score| score.rmse_m)
        };
        row(&mut text, &format!("`{name}`"), classes().map(ours));
        if let Some(printed) = printed(method) {
            row(&mut text, "as printed", classes().map(|class| printed.rmse_m(class)));
        }
    }
    text.push('\n');
    text
}

fn row(text: &mut String, name: &str, figures: impl Iterator<Item = Option<f64>>) {
    let _ = write!(text, "\n| {name:14} |");
    for figure in figures {
        let figure = figure.map_or_else(String::new, |figure| format!("{figure:.3}"));
        let _ = write!(text, " {figure:>5} |");
    }
}
