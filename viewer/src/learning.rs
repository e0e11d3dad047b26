use std::path::Path;

use rerun::ApplicationId;

use crate::rrd::RrdFile;
use crate::{ViewerError, palette};

/// Rounds of training follow one another on this timeline, by number.
const TIMELINE: &str = "round";

/// Writes a learning curve as time series at `path`: a series for each of `names`, a row of values
/// in their order for each round.
///
/// # Errors
/// When the file can't be written.
pub fn record_learning_curve(
    path: &Path,
    names: &[&str],
    rounds: &[(u64, Vec<f64>)],
) -> Result<(), ViewerError> {
    let application = ApplicationId::new_or_unknown("covista learning");
    let file = RrdFile::create(path, application, "learning")?;
    log(&file, names, rounds).map_err(|error| file.error(error))?;
    file.finish()
}

fn log(
    file: &RrdFile,
    names: &[&str],
    rounds: &[(u64, Vec<f64>)],
) -> rerun::RecordingStreamResult<()> {
    for (index, &name) in names.iter().enumerate() {
        let style = rerun::SeriesLines::new()
            .with_names([name])
            .with_colors([rerun::Color::from(palette::series_color(index))]);
        file.stream.log_static(format!("learning/{name}"), &style)?;
    }
    for (round, values) in rounds {
        file.stream.set_time_sequence(TIMELINE, *round as i64);
        for (&name, &value) in names.iter().zip(values) {
            let path = format!("learning/{name}");
            file.stream.log(path, &rerun::Scalars::single(value))?;
        }
    }
    Ok(())
}
