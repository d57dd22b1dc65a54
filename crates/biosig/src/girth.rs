//! Which girths are measured, and how each is defined.

/// A girth: the length of a tape around the body, that is, the perimeter of the convex hull of a plane section.
///
/// Numbers in brackets are sections of ISO 8559-1:2017; where our plane differs from the standard's, the variant says so.
/// The body stands in the rest pose: upright, arms held away from the trunk, legs apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Girth {
    /// Bust girth (5.3.4): horizontal, at the height of the bust points (nipples).
    Chest,
    /// Horizontal, through the navel, as the ANSUR survey takes it. Deviation: the waist girth of the standard (5.3.10) lies
    /// halfway between the lowest rib and the top of the hip bone.
    Waist,
    /// Hip girth (5.3.13): horizontal, at the rearmost point of the buttocks.
    Hips,
    /// Thigh girth (5.3.20): horizontal, right leg, just below the fold of the buttock, here 2 cm below the crotch.
    RightThigh,
    /// Calf girth (5.3.24): the largest horizontal girth of the right calf.
    RightCalf,
    /// Neck girth (5.3.2): just below the Adam's apple, square to the neck.
    Neck,
    /// Upper-arm girth (5.3.16): square to the right upper arm, relaxed. Deviation: 55 % of the way from the joint of the shoulder
    /// to that of the elbow instead of halfway between shoulder point and elbow point on the skin.
    RightUpperArm,
    /// The smallest horizontal girth between 2 cm below the navel and 6 cm below the bust points.
    SmallestWaist,
    /// The largest horizontal girth from 2 cm above the crotch to three quarters of the way to the navel.
    LargestHips,
}

impl Girth {
    /// Every girth, in the order of [`Measurements::girths`](crate::Measurements::girths).
    pub const ALL: [Self; 9] = [
        Self::Chest,
        Self::Waist,
        Self::Hips,
        Self::RightThigh,
        Self::RightCalf,
        Self::Neck,
        Self::RightUpperArm,
        Self::SmallestWaist,
        Self::LargestHips,
    ];

    /// Its name in files and tables, as in `right_thigh`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Chest => "chest",
            Self::Waist => "waist",
            Self::Hips => "hips",
            Self::RightThigh => "right_thigh",
            Self::RightCalf => "right_calf",
            Self::Neck => "neck",
            Self::RightUpperArm => "right_upper_arm",
            Self::SmallestWaist => "waist_smallest",
            Self::LargestHips => "hips_largest",
        }
    }

    /// How it is defined, for files and tables.
    pub const fn definition(self) -> &'static str {
        match self {
            Self::Chest => "ISO 8559-1 5.3.4 bust girth: horizontal, at the bust points",
            Self::Waist => {
                "horizontal, at the navel (ANSUR II waist; ISO 8559-1 5.3.10 lies between rib and hip bone)"
            }
            Self::Hips => "ISO 8559-1 5.3.13 hip girth: horizontal, at the rearmost point of the buttocks",
            Self::RightThigh => "ISO 8559-1 5.3.20 thigh girth: horizontal, 2 cm below the crotch",
            Self::RightCalf => "ISO 8559-1 5.3.24 calf girth: the largest horizontal one",
            Self::Neck => "ISO 8559-1 5.3.2 neck girth: below the Adam's apple, square to the neck",
            Self::RightUpperArm => {
                "ISO 8559-1 5.3.16 upper-arm girth, relaxed: square to the arm, 55 % of the way from shoulder to elbow joint"
            }
            Self::SmallestWaist => {
                "the smallest horizontal girth from 2 cm below the navel to 6 cm below the bust points"
            }
            Self::LargestHips => {
                "the largest horizontal girth from 2 cm above the crotch to three quarters of the way to the navel"
            }
        }
    }

    pub(crate) const fn index(self) -> usize {
        self as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_are_places_in_the_list() {
        for (place, girth) in Girth::ALL.into_iter().enumerate() {
            assert_eq!(girth.index(), place);
        }
    }
}
