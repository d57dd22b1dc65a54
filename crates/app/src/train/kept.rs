//! Models that an earlier training left behind: taken instead of trained again, if they learned from the same.

use std::fs;
use std::path::Path;

use anyhow::{Context as _, ensure};

use super::DescriptorKind;
use crate::predict::{LatentPoses, PosePredictor};

/// The predictor in a file, which must have learned from what `notice` names and describe masks by `descriptor`.
///
/// # Errors
/// When the file cannot be read or holds another one.
pub fn kept_predictor(
    path: &Path,
    notice: &str,
    descriptor: DescriptorKind,
) -> anyhow::Result<PosePredictor> {
    let predictor = PosePredictor::read(path)?;
    let kind = DescriptorKind::of(predictor.descriptor());
    ensure!(
        kind == descriptor,
        "{}: `descriptor` is {kind:?}, expected {descriptor:?}: remove the file or name another folder",
        path.display()
    );
    ensure_same(path, "training.notice", &predictor.training().notice, notice)?;
    Ok(predictor)
}

/// The latent poses in a file, which must have been learned from what `notice` names.
///
/// # Errors
/// When the file cannot be read or holds other ones.
pub fn kept_latent(path: &Path, notice: &str) -> anyhow::Result<LatentPoses> {
    let bytes = fs::read(path).with_context(|| format!("{}: cannot read the file", path.display()))?;
    let latent = LatentPoses::from_bytes(&bytes).with_context(|| format!("{}", path.display()))?;
    ensure_same(path, "notice", latent.notice(), notice)?;
    Ok(latent)
}

fn ensure_same(path: &Path, field: &str, found: &str, expected: &str) -> anyhow::Result<()> {
    ensure!(
        found == expected,
        "{}: `{field}` is \"{found}\", expected \"{expected}\": remove the file or name another folder",
        path.display()
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::predict::Activity;

    #[test]
    fn models_of_other_frames_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("S3-Jog_1.bin");
        let shipped = Activity::Any.predictor();
        shipped.write_small(&path).unwrap();
        let own = &shipped.training().notice;
        assert!(kept_predictor(&path, own, DescriptorKind::Crop).is_ok());
        let other = "frames 200 to 523 of S3 Jog";
        let error = kept_predictor(&path, other, DescriptorKind::Crop).unwrap_err().to_string();
        assert!(error.contains("S3-Jog_1.bin: `training.notice` is \""), "{error}");
        assert!(error.contains(own.as_str()) && error.contains(&format!("expected \"{other}\"")), "{error}");
        let error = kept_predictor(&path, own, DescriptorKind::Histogram).unwrap_err().to_string();
        assert!(error.contains("`descriptor` is Crop, expected Histogram"), "{error}");

        let path = folder.path().join("latent-walk.bin");
        let latent = Activity::Walk.latent();
        fs::write(&path, latent.to_bytes()).unwrap();
        assert!(kept_latent(&path, latent.notice()).is_ok());
        let error = kept_latent(&path, other).unwrap_err().to_string();
        assert!(error.contains("latent-walk.bin: `notice` is \""), "{error}");
        fs::write(&path, &latent.to_bytes()[..1000]).unwrap();
        let error = format!("{:#}", kept_latent(&path, latent.notice()).unwrap_err());
        assert!(error.contains("latent-walk.bin: the file has 1000 bytes, expected "), "{error}");
    }
}
