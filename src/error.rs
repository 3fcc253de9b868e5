//! The crate has one error type. An error says what failed, on which file, field or object, and what the user
//! can do.

/// Says what went wrong. `Display` gives one line: subject, problem, remedy.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Something that the user gave cannot be used: an unreadable input, a wrong value, an unwritable output.
    #[error("{subject}: {problem}; {remedy}")]
    Input {
        /// The file, flag or `file: field` it is about.
        subject: String,
        /// What is wrong with it.
        problem: String,
        /// What the user can do.
        remedy: String,
    },
    /// There is no Vulkan device that this program can run on.
    #[error("no usable Vulkan device: {problem}; {remedy}")]
    NoDevice {
        /// Why each candidate was refused.
        problem: String,
        /// What the user can do.
        remedy: String,
    },
    /// A Vulkan call failed.
    #[error("Vulkan: {during}: {result:?}")]
    Vulkan {
        /// The call, and the pass or resource it was for.
        during: String,
        /// The driver's answer.
        result: ash::vk::Result,
    },
    /// A measured value is beyond its limit, and the user asked for that to be an error.
    #[error("{subject}: {problem}")]
    Beyond {
        /// What was measured.
        subject: String,
        /// Which values are beyond their limits.
        problem: String,
    },
    /// The user stopped the work. What was done is kept.
    #[error("{subject}: interrupted {at}; {remedy}")]
    Interrupted {
        /// The output.
        subject: String,
        /// How far it got.
        at: String,
        /// How to go on.
        remedy: String,
    },
    /// The program has a fault: a shader and its declaration disagree, or a barrier is missing.
    #[error("internal: {0}")]
    Internal(String),
}

/// The result type of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Makes an [`Error::Input`].
    pub fn input(subject: impl ToString, problem: impl ToString, remedy: impl ToString) -> Self {
        Self::Input { subject: subject.to_string(), problem: problem.to_string(), remedy: remedy.to_string() }
    }

    /// Returns the process's exit status: 2 for what the user gave, 3 for no device, 130 if it was interrupted,
    /// 1 for the rest.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Input { .. } => 2,
            Self::NoDevice { .. } => 3,
            Self::Interrupted { .. } => 130,
            Self::Vulkan { .. } | Self::Beyond { .. } | Self::Internal(_) => 1,
        }
    }
}
