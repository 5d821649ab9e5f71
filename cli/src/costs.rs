//! What trees cost on a device, for `--quality auto`: measured once, and kept.

use crate::{hints, notes::Notes, report::capitals};
use raykd::{
    Device, Error,
    plan::{Calibration, create_cache_file},
};
use std::path::Path;

/// How many times longer the slowest round of a measurement takes than the fastest where other work disturbs it.
const DISTURBED: f64 = 1.5;

/// Measures it anew. Says so if most costs varied.
pub(super) fn measure(device: &Device, notes: &Notes) -> Result<Calibration, Error> {
    let calibration = Calibration::measure(device, |done| {
        notes.stage(format_args!(
            "measuring what trees cost on the {}, {:.0} %",
            capitals(device),
            100.0 * done
        ));
    })?;
    let disturbed = calibration.costs().iter().filter(|cost| cost.spread > DISTURBED).count();
    if 2 * disturbed > calibration.costs().len() {
        notes.note(format_args!(
            "most costs of the {} varied from round to round: if the machine did other work, run `raykd calibrate` \
             again without it",
            capitals(device)
        ));
    }
    Ok(calibration)
}

/// The costs of a device: from the file given, or the cache, or measured now and kept there.
pub(super) fn costs(device: &Device, file: Option<&Path>, notes: &Notes) -> Result<Calibration, Error> {
    if let Some(path) = file {
        return Calibration::load(path, device);
    }
    kept_or(device, notes, || measure(device, notes))
}

/// The costs kept in the cache, or new ones, kept there if that can be.
fn kept_or(
    device: &Device,
    notes: &Notes,
    measure: impl FnOnce() -> Result<Calibration, Error>,
) -> Result<Calibration, Error> {
    match Calibration::from_cache(device) {
        Some(Ok(found)) => return Ok(found),
        Some(Err(error)) => notes.note(hints::told(&error)),
        None => {}
    }
    let place = create_cache_file(device);
    let once = match &place {
        Ok(_) => "once",
        Err(error) => {
            notes.note(format_args!("costs cannot be kept: {error}"));
            "for this run"
        }
    };
    notes.note(format_args!(
        "measuring what trees cost on this {}, {once}; it takes a minute or two",
        capitals(device)
    ));
    let calibration = measure()?;
    if let Err(error) = place.map_or(Ok(()), |path| calibration.save(&path)) {
        notes.note(format_args!("costs could not be kept: {error}"));
    }
    Ok(calibration)
}
