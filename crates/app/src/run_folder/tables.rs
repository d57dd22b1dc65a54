//! `poses.csv` and `joints.csv`: one row a frame, units in the header.

use std::fmt::Write as _;

use body::{JointId, Skeleton};

use super::record::{Entry, FrameRecord, Learned};

/// Time of a frame, seconds; frame 0 is at 0.
pub(super) fn time_s(frame: u64, fps: f64) -> f64 {
    frame as f64 / fps
}

/// Pelvis, orientation and joint angles of every frame, and what tells how far to trust it; of a run that learned, what the
/// predictor made of the frame too.
pub(super) fn poses_csv(entries: &[Entry], fps: f64) -> String {
    let mut header =
        "frame,time_s,status,root_x_m,root_y_m,root_z_m,root_qw,root_qx,root_qy,root_qz".to_owned();
    for dof in Skeleton::human().dofs() {
        push(&mut header, format_args!(",{}_rad", dof.name));
    }
    header.push_str(",iou,mean_joint_sd_m,effective_sample_size,unique_ancestors,log_evidence");
    let learns = entries.iter().any(|entry| entry.record.learned.is_some());
    if learns {
        header.push_str(",bases_added,bases_reestimated,bases_deleted,log_evidence_gain");
    }
    rows(header, entries, fps, |record, row| {
        let (position, orientation) = (record.pose.root_position, record.pose.root_orientation);
        numbers(row, &position.to_array(), 6);
        numbers(row, &[orientation.w, orientation.x, orientation.y, orientation.z], 9);
        numbers(row, &record.pose.angles, 6);
        numbers(row, &[record.iou, mean_joint_sd_m(record)], 6);
        numbers(row, &[record.effective_sample_size], 3);
        push(row, format_args!(",{}", record.unique_ancestors));
        numbers(row, &[record.log_evidence], 6);
        match record.learned {
            Some(Learned { added, reestimated, deleted, log_evidence_gain, .. }) => {
                push(row, format_args!(",{added},{reestimated},{deleted}"));
                numbers(row, &[log_evidence_gain], 6);
            }
            None if learns => row.push_str(",,,,"),
            None => {}
        }
    })
}

/// Position of every joint and its standard deviation.
pub(super) fn joints_csv(entries: &[Entry], fps: f64) -> String {
    let mut header = "frame,time_s,status".to_owned();
    for joint in JointId::all() {
        let name = joint.name();
        push(&mut header, format_args!(",{name}_x_m,{name}_y_m,{name}_z_m,{name}_sd_m"));
    }
    rows(header, entries, fps, |record, row| {
        for (position, sd_m) in record.joints_world.iter().zip(record.joint_sd_m) {
            numbers(row, &[position.x, position.y, position.z, sd_m], 6);
        }
    })
}

/// Mean over the joints of the standard deviation of their positions, metres.
pub(super) fn mean_joint_sd_m(record: &FrameRecord) -> f64 {
    record.joint_sd_m.iter().sum::<f64>() / record.joint_sd_m.len() as f64
}

fn rows(header: String, entries: &[Entry], fps: f64, fill: impl Fn(&FrameRecord, &mut String)) -> String {
    let mut text = header;
    text.push('\n');
    for Entry { record, .. } in entries {
        let status = record.status.name();
        push(&mut text, format_args!("{},{:.6},{status}", record.frame, time_s(record.frame, fps)));
        fill(record, &mut text);
        text.push('\n');
    }
    text
}

/// Appends cells; a number that is not finite becomes an empty one.
fn numbers(row: &mut String, values: &[f64], decimals: usize) {
    for value in values {
        if value.is_finite() {
            push(row, format_args!(",{value:.decimals$}"));
        } else {
            row.push(',');
        }
    }
}

fn push(text: &mut String, cells: std::fmt::Arguments<'_>) {
    text.write_fmt(cells).expect("writing into a string cannot fail");
}
