//! The file of attitudes.

use std::io::{BufWriter, Write};
use std::path::Path;

use anyhow::Context;
use whorl_files::NewFile;
use whorl_free_motion::Orientation;

/// Time, quaternion, bias, standard deviations and, if wanted, the whole covariance.
pub struct Output {
    file: BufWriter<NewFile>,
    covariance: bool,
}

const WRITING: &str = "writing the attitudes";

impl Output {
    pub fn create(path: &Path, covariance: bool) -> anyhow::Result<Self> {
        let file = NewFile::create(path).with_context(|| format!("cannot create {}", path.display()))?;
        let mut file = BufWriter::new(file);
        write!(
            file,
            "time_s,qw,qx,qy,qz,gyro_bias_x_rad_s,gyro_bias_y_rad_s,gyro_bias_z_rad_s,\
             sigma_east_rad,sigma_north_rad,sigma_heading_rad"
        )
        .context(WRITING)?;
        if covariance {
            for row in 1..=6 {
                for column in row..=6 {
                    write!(file, ",p{row}{column}").context(WRITING)?;
                }
            }
        }
        writeln!(file).context(WRITING)?;
        Ok(Self { file, covariance })
    }

    pub fn write(&mut self, since_start_ns: i64, estimate: &Orientation) -> anyhow::Result<()> {
        let (q, b) = (&estimate.q_world_body, &estimate.gyro_bias_rad_s);
        let s = estimate.covariance_w_rad2().diagonal().map(|v| v.max(0.0).sqrt());
        write!(
            self.file,
            "{:.6},{:.9},{:.9},{:.9},{:.9},{:.6e},{:.6e},{:.6e},{:.3e},{:.3e},{:.3e}",
            since_start_ns as f64 * 1e-9,
            q.w,
            q.i,
            q.j,
            q.k,
            b.x,
            b.y,
            b.z,
            s.x,
            s.y,
            s.z
        )
        .context(WRITING)?;
        if self.covariance {
            for row in 0..6 {
                for column in row..6 {
                    write!(self.file, ",{:.6e}", estimate.covariance[(row, column)]).context(WRITING)?;
                }
            }
        }
        writeln!(self.file).context(WRITING)
    }

    pub fn finish(self) -> anyhow::Result<()> {
        let file = self.file.into_inner().map_err(std::io::IntoInnerError::into_error);
        file.and_then(NewFile::finish).context(WRITING)
    }
}
