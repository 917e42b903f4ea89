//! Points of an episode to return to, in memory or as bytes.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{Environment, Progress, Replay};
use crate::observe::Readings;
use crate::past::Kept;
use crate::random::EpisodeKey;
use crate::setup::Setup;

/// First bytes of a snapshot; the last one is the version of what follows.
const MAGIC: &[u8; 8] = b"smplsnp\x08";

/// Bytes at the end: the hash of all before them.
const SUM: usize = blake3::OUT_LEN;

/// A point of an episode to return to; it belongs to environments of the same model.
#[derive(Clone)]
pub struct Snapshot {
    origin: Origin,
    content: Content,
}

/// Point of a snapshot.
#[derive(Clone)]
enum Origin {
    /// In this process.
    Here(Arc<Setup>),
    /// Elsewhere: the name of the model and [`Setup::checksum`].
    Elsewhere(String, [u8; 32]),
}

/// All that an environment goes on from: what the integrator carries over from step to step is in
/// `progress`.
#[derive(Clone, Serialize, Deserialize)]
struct Content {
    memory: Vec<f64>,
    progress: Progress,
    replay: Vec<Replay>,
    past: Option<Kept>,
}

/// Reason why a snapshot cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SnapshotError {
    /// It does not belong to the environment.
    #[error(
        "the snapshot is of {snapshot}, the environment of {environment}: both must come from one model (same text, scenario, variants, settings, observations, and version of smpl)"
    )]
    Foreign {
        /// Model of the snapshot with the beginning of its checksum.
        snapshot: String,
        /// Model of the environment.
        environment: String,
    },
    /// The bytes are not a snapshot, or damaged.
    #[error("not a snapshot, or a damaged one: {0}")]
    Damaged(String),
    /// The model cannot be encoded.
    #[error("the model has no checksum: {0}")]
    Checksum(String),
}

impl Snapshot {
    /// The snapshot as bytes, which name the model by its checksum and do not contain it.
    ///
    /// # Errors
    /// If the model cannot be encoded.
    pub fn to_bytes(&self) -> Result<Vec<u8>, SnapshotError> {
        let encoded = postcard::to_extend(&self.origin.identity()?, MAGIC.to_vec());
        let encoded = encoded.and_then(|bytes| postcard::to_extend(&self.content, bytes));
        let mut bytes = encoded.map_err(|e| SnapshotError::Checksum(e.to_string()))?;
        let sum = blake3::hash(&bytes);
        bytes.extend_from_slice(sum.as_bytes());
        Ok(bytes)
    }

    /// The snapshot of [`to_bytes`](Self::to_bytes). Whether it fits an environment shows when it
    /// is restored.
    ///
    /// # Errors
    /// If the bytes are anything else.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SnapshotError> {
        let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| SnapshotError::Damaged("wrong first bytes".into()))?;
        let end = rest.len().checked_sub(SUM).ok_or_else(|| SnapshotError::Damaged("too short".into()))?;
        let (content, sum) = bytes.split_at(MAGIC.len() + end);
        if blake3::hash(content).as_bytes() != sum {
            return Err(SnapshotError::Damaged("its checksum is another".into()));
        }
        let rest = &rest[..end];
        let damaged = |e: postcard::Error| SnapshotError::Damaged(e.to_string());
        let ((name, checksum), rest) = postcard::take_from_bytes(rest).map_err(damaged)?;
        Ok(Self { origin: Origin::Elsewhere(name, checksum), content: postcard::from_bytes(rest).map_err(damaged)? })
    }
}

impl Origin {
    /// Name and checksum of the model.
    fn identity(&self) -> Result<(String, [u8; 32]), SnapshotError> {
        match self {
            Origin::Here(setup) => Ok((setup.model().interface().name.clone(), setup.checksum().map_err(SnapshotError::Checksum)?)),
            Origin::Elsewhere(name, checksum) => Ok((name.clone(), *checksum)),
        }
    }
}

impl Environment {
    /// Keeps the present point of the episode.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        let content = Content {
            memory: self.system.memory().all().to_vec(),
            progress: self.progress.clone(),
            replay: self.replay.clone(),
            past: self.system.past().cloned(),
        };
        Snapshot { origin: Origin::Here(Arc::clone(&self.setup)), content }
    }

    /// The random numbers of the steps to come are at their means, and measurements without noise.
    pub(crate) fn expect(&mut self) {
        self.progress.expected = true;
        for draw in self.setup.draws.iter().filter(|d| d.each_step) {
            self.system.region_mut(smpl_compiler::layout::Region::Draw)[draw.at] = draw.mean();
        }
    }

    /// The random numbers of the steps to come are those of another seed.
    pub(crate) fn draw_anew(&mut self, seed: u64) {
        self.progress.expected = false;
        self.progress.key = EpisodeKey::seeded(seed);
    }

    /// Returns to a point kept before: from there on every bit is the same.
    ///
    /// # Errors
    /// When the snapshot is of another model (another text, scenario, variant, setting or
    /// observation level).
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), SnapshotError> {
        let same = matches!(&snapshot.origin, Origin::Here(setup) if Arc::ptr_eq(setup.model(), self.setup.model()));
        if !same {
            self.compare(&snapshot.origin)?;
        }
        let Content { memory, progress, replay, past } = &snapshot.content;
        if self.system.memory().all().len() != memory.len() || self.progress.lengths() != progress.lengths() {
            return Err(SnapshotError::Damaged("wrong lengths".into()));
        }
        let disturbances = self.disturbances().len();
        if replay.iter().any(|replay| replay.at >= disturbances || replay.values.is_empty()) {
            return Err(SnapshotError::Damaged("wrong disturbances".into()));
        }
        if !self.system.take_past(past.as_ref()) {
            return Err(SnapshotError::Damaged("wrong past".into()));
        }
        self.system.restore(memory);
        self.progress.clone_from(progress);
        self.replay.clone_from(replay);
        Ok(())
    }

    /// Refuses what was taken of another model.
    fn compare(&self, origin: &Origin) -> Result<(), SnapshotError> {
        let (snapshot, environment) = (origin.identity()?, Origin::Here(Arc::clone(&self.setup)).identity()?);
        if snapshot.1 == environment.1 {
            return Ok(());
        }
        let named = |(name, sum): (String, [u8; 32])| format!("{name} [{:02x}{:02x}{:02x}{:02x}]", sum[0], sum[1], sum[2], sum[3]);
        Err(SnapshotError::Foreign { snapshot: named(snapshot), environment: named(environment) })
    }
}

impl Progress {
    fn lengths(&self) -> [usize; 9] {
        let Readings { present, missing, pipeline } = &self.readings;
        let values = [&self.y, &self.yp, present, pipeline, &self.verdict.rewards, &self.verdict.violations].map(Vec::len);
        let [y, yp, present, pipeline, rewards, violations] = values;
        [y, yp, present, missing.len(), pipeline, rewards, violations, self.verdict.failing.len(), self.edges.len()]
    }
}
