//! A calibration to the bytes that lie in flash, and back.

use super::layouts::{EffectHead, Header};
use super::{Calibration, EffectTerm, ImageError, Parts, Uncertainty, DIRECTIONS, MAGIC, MAX_BYTES, OLDEST, VERSION};
use crate::accelerometers::Accelerometers;
use crate::bias::Coefficients;
use crate::bytes::{crc32, Digest, Reader, Writer};
use crate::effects::{shape, Shape, MAX_OUTPUTS};
use crate::half::Half;
use crate::inputs::Input;
use crate::rate_factors::RateAxis;
use crate::schema::{size, take, Layout, Wire};
use crate::specific_force::Accelerometer;
use crate::visited::Visited;
use crate::AXES;
use heapless::Vec;

/// Bytes at the front of an image that are programmed last.
pub const COMMIT: usize = MAGIC.len();

/// Bytes that replace the first ones of an image that was refused.
pub const REFUSED: [u8; COMMIT] = [0; COMMIT];

/// Bytes before the payload.
const HEADER: usize = size(Header::FIELDS);

/// The length that the header at the front of `bytes` states, valid or not; `None` where there is no header.
#[must_use]
pub fn stated_length(bytes: &[u8]) -> Option<usize> {
    let header: Header = take(&mut Reader::new(bytes))?;
    Some(usize::from(header.length))
}

impl Calibration {
    /// The image, ready for flash. `None` cannot happen for a value that [`from_bytes`](Self::from_bytes) gave.
    #[must_use]
    pub fn to_bytes(&self) -> Option<Vec<u8, MAX_BYTES>> {
        let mut buffer = [0u8; MAX_BYTES];
        let mut w = Writer::new(&mut buffer);
        let parts = self.parts();
        Header { magic: MAGIC, version: VERSION, parts: parts.bits(), length: 0 }.put_fields(&mut w);
        self.write_payload(&mut w);
        if parts.contains(Parts::UNCERTAINTY) {
            self.write_uncertainty(&mut w);
        }
        if parts.contains(Parts::ACCELEROMETERS) {
            self.accelerometers.put_fields(&mut w);
        }
        for axis in self.rates.iter().flatten() {
            axis.put_fields(&mut w);
        }
        if parts.contains(Parts::VISITED) {
            self.axes.iter().for_each(|a| a.visited.put_fields(&mut w));
        }
        if parts.contains(Parts::INPUTS) {
            w.u8(self.inputs.len() as u8);
            self.inputs.iter().for_each(|i| i.put_fields(&mut w));
        }
        for one in self.specific_force.iter().flatten() {
            one.bias.put_fields(&mut w);
            one.errors.put_fields(&mut w);
        }
        let payload_end = w.finish()?;
        let length = payload_end + 4;
        if length > MAX_BYTES {
            return None;
        }
        buffer[6..8].copy_from_slice(&(length as u16).to_le_bytes());
        let crc = crc32(&buffer[..payload_end]);
        buffer[payload_end..length].copy_from_slice(&crc.to_le_bytes());
        Vec::from_slice(&buffer[..length]).ok()
    }

    /// Reads an image; `bytes` may be longer than the image (a flash sector). The name of the unit is not compared:
    /// [`Calibration::unit`] has it, and the program must know its own.
    ///
    /// # Errors
    /// Each defect has its own [`ImageError`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ImageError> {
        Self::from_bytes_up_to(VERSION, bytes)
    }

    /// Reads an image whose first bytes are not in flash yet: they are programmed last, and only then it counts.
    ///
    /// # Errors
    /// As [`from_bytes`](Self::from_bytes).
    pub fn from_uncommitted(first: [u8; COMMIT], bytes: &[u8]) -> Result<Self, ImageError> {
        if first != MAGIC {
            return Err(ImageError::Foreign);
        }
        Self::read_behind_magic(VERSION, bytes)
    }

    /// The same by a program whose newest version is this.
    pub(super) fn from_bytes_up_to(newest: u8, bytes: &[u8]) -> Result<Self, ImageError> {
        if !bytes.starts_with(&MAGIC) {
            // A sector that is erased or whose image was refused holds no fault; an image whose first bytes are corrupted does.
            let erased = bytes.iter().take(MAX_BYTES).all(|b| *b == 0xFF) || bytes.starts_with(&REFUSED);
            return Err(if erased { ImageError::NoImage } else { ImageError::Foreign });
        }
        Self::read_behind_magic(newest, bytes)
    }

    fn read_behind_magic(newest: u8, bytes: &[u8]) -> Result<Self, ImageError> {
        let Header { version, parts, length, .. } = take(&mut Reader::new(bytes)).ok_or(ImageError::Length(0))?;
        if !(OLDEST..=newest).contains(&version) {
            return Err(ImageError::Version(version));
        }
        let n = usize::from(length);
        if !(HEADER + 4..=MAX_BYTES).contains(&n) || n > bytes.len() {
            return Err(ImageError::Length(length));
        }
        let (content, crc) = bytes[..n].split_at(n - 4);
        let mut digest = Digest::default();
        digest.update(&MAGIC);
        digest.update(&content[COMMIT..]);
        if crc != digest.finish().to_le_bytes() {
            return Err(ImageError::Checksum);
        }
        let Some(parts) = Parts::from_bits(parts) else {
            return Err(ImageError::UnknownPart(parts));
        };
        let mut payload = Reader::new(&content[HEADER..]);
        let mut calibration = Self::uncalibrated();
        calibration.read_payload(&mut payload).ok_or(ImageError::Length(length))??;
        if parts.contains(Parts::UNCERTAINTY) {
            calibration.read_uncertainty(&mut payload).ok_or(ImageError::Length(length))??;
        }
        if parts.contains(Parts::ACCELEROMETERS) {
            calibration.accelerometers.take_fields(&mut payload).ok_or(ImageError::Length(length))?;
        }
        if parts.contains(Parts::RATES) {
            let mut rates = [RateAxis::default(); AXES];
            for axis in &mut rates {
                axis.take_fields(&mut payload).ok_or(ImageError::Length(length))?;
            }
            calibration.rates = Some(rates);
        }
        if parts.contains(Parts::VISITED) {
            for axis in &mut calibration.axes {
                axis.visited.take_fields(&mut payload).ok_or(ImageError::Length(length))?;
            }
        }
        if parts.contains(Parts::INPUTS) {
            calibration.read_inputs(&mut payload).ok_or(ImageError::Length(length))??;
        }
        if parts.contains(Parts::SPECIFIC_FORCE) {
            let mut all = [Accelerometer::default(); AXES];
            for one in &mut all {
                one.bias.take_fields(&mut payload).ok_or(ImageError::Length(length))?;
                one.errors.take_fields(&mut payload).ok_or(ImageError::Length(length))?;
            }
            calibration.specific_force = Some(all);
        }
        if payload.remaining() != 0 {
            return Err(ImageError::Length(length));
        }
        calibration.check()?;
        Ok(calibration)
    }

    /// The image's checksum: its identity in housekeeping and log.
    #[must_use]
    pub fn checksum(&self) -> u32 {
        let Some(bytes) = self.to_bytes() else {
            return 0;
        };
        let end = bytes.len() - 4;
        u32::from_le_bytes([bytes[end], bytes[end + 1], bytes[end + 2], bytes[end + 3]])
    }

    fn write_payload(&self, w: &mut Writer<'_>) {
        self.put_fields(w);
        self.scaling.put_fields(w);
        for a in &self.axes {
            a.curve.put_fields(w);
            w.u8(a.coefficients.kind());
            match &a.coefficients {
                Coefficients::One(k) => k.put(w),
                Coefficients::CoolingHeating(cooling, heating) => [*cooling, *heating].put(w),
                Coefficients::FourParameter(m) => m.put_fields(w),
                Coefficients::Direct(k) => k.put(w),
                Coefficients::Network(weights) => weights.put(w),
            }
            a.put_fields(w);
        }
        w.u8(self.effects.len() as u8);
        for e in &self.effects {
            let outputs = shape(e.id).map_or(MAX_OUTPUTS, |f| f.outputs);
            EffectHead { id: e.id, outputs: outputs as u8, parameters: e.parameters, start: e.start }.put_fields(w);
            for (g, s) in e.gains.iter().zip(&e.gain_std) {
                w.f32s(&g[..outputs]);
                w.f32s(&s[..outputs]);
            }
        }
    }

    /// The parts that state anything: the others are not written, and an older program that lacks them reads the image.
    fn parts(&self) -> Parts {
        let mut parts = Parts::empty();
        let uncertain = self.directions() > 0 || self.axes.iter().any(|a| a.uncertainty != Uncertainty::default());
        parts.set(Parts::UNCERTAINTY, uncertain);
        parts.set(Parts::ACCELEROMETERS, self.accelerometers != Accelerometers::IDEAL);
        parts.set(Parts::RATES, self.rates.is_some());
        parts.set(Parts::INPUTS, !self.inputs.is_empty());
        parts.set(Parts::SPECIFIC_FORCE, self.specific_force.is_some());
        parts.set(Parts::VISITED, self.axes.iter().any(|a| a.visited != Visited::default()));
        parts
    }

    /// Directions that hold anything: the others are not written.
    fn directions(&self) -> usize {
        let any = |k: usize| {
            let mut own = self.axes.iter().flat_map(|a| a.uncertainty.baseline[k]);
            let mut effects = self.effects.iter().flat_map(|e| e.directions[k].iter().flatten());
            own.any(|v| v != 0.0) || effects.any(|v| v.value() != 0.0)
        };
        (0..DIRECTIONS).rev().find(|k| any(*k)).map_or(0, |k| k + 1)
    }

    fn write_uncertainty(&self, w: &mut Writer<'_>) {
        w.f32s(&self.axes.each_ref().map(|a| a.uncertainty.rest_dph2));
        let count = self.directions();
        w.u8(count as u8);
        for k in 0..count {
            for (number, axis) in self.axes.iter().enumerate() {
                w.f32s(&axis.uncertainty.baseline[k]);
                for e in &self.effects {
                    let outputs = shape(e.id).map_or(MAX_OUTPUTS, |f| f.outputs.min(MAX_OUTPUTS));
                    for gain in &e.directions[k][number][..outputs] {
                        w.u16(gain.bits());
                    }
                }
            }
        }
    }

    #[inline(never)]
    fn read_uncertainty(&mut self, r: &mut Reader<'_>) -> Option<Result<(), ImageError>> {
        let rest: [f32; AXES] = r.f32s()?;
        for (a, rest_dph2) in self.axes.iter_mut().zip(rest) {
            a.uncertainty = Uncertainty { rest_dph2, ..Uncertainty::default() };
        }
        let count = usize::from(r.u8()?);
        if count > DIRECTIONS {
            return Some(Err(ImageError::Absurd("number of directions")));
        }
        for k in 0..count {
            for (number, axis) in self.axes.iter_mut().enumerate() {
                axis.uncertainty.baseline[k] = r.f32s()?;
                for e in &mut self.effects {
                    let outputs = shape(e.id).map_or(MAX_OUTPUTS, |f| f.outputs);
                    for gain in e.directions[k][number].iter_mut().take(outputs) {
                        *gain = Half::from_bits(r.u16()?);
                    }
                }
            }
        }
        Some(Ok(()))
    }

    #[inline(never)]
    fn read_inputs(&mut self, r: &mut Reader<'_>) -> Option<Result<(), ImageError>> {
        for _ in 0..r.u8()? {
            let input: Input = take(r)?;
            if self.inputs.push(input).is_err() {
                return Some(Err(ImageError::Absurd("number of inputs")));
            }
        }
        Some(Ok(()))
    }

    /// Reads what each image holds; `None` where it is too short.
    #[inline(never)]
    fn read_payload(&mut self, r: &mut Reader<'_>) -> Option<Result<(), ImageError>> {
        self.take_fields(r)?;
        self.scaling.take_fields(r)?;
        for a in &mut self.axes {
            a.curve.take_fields(r)?;
            a.coefficients = match r.u8()? {
                1 => Coefficients::One(Wire::take(r)?),
                2 => {
                    let [cooling, heating] = Wire::take(r)?;
                    Coefficients::CoolingHeating(cooling, heating)
                }
                3 => Coefficients::FourParameter(take(r)?),
                4 => Coefficients::Direct(Wire::take(r)?),
                5 => Coefficients::Network(Wire::take(r)?),
                kind => return Some(Err(ImageError::UnknownModel(kind))),
            };
            a.take_fields(r)?;
        }
        self.effects.clear();
        for _ in 0..r.u8()? {
            let EffectHead { id, outputs: stated, parameters, start } = take(r)?;
            let Some(Shape { outputs, .. }) = shape(id) else {
                return Some(Err(ImageError::UnknownEffect(id)));
            };
            if usize::from(stated) != outputs {
                return Some(Err(ImageError::Absurd("number of gains of an effect")));
            }
            let outputs = outputs.min(MAX_OUTPUTS);
            let mut e = EffectTerm { start, ..EffectTerm::new(id, parameters) };
            for (gains, std) in e.gains.iter_mut().zip(&mut e.gain_std) {
                r.fill(&mut gains[..outputs])?;
                r.fill(&mut std[..outputs])?;
            }
            if self.effects.push(e).is_err() {
                return Some(Err(ImageError::Absurd("number of effects")));
            }
        }
        Some(Ok(()))
    }
}
