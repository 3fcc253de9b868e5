//! The thread that draws the window. Presenting waits for the device, and events must not wait.

use crate::{
    Error, Result,
    gpu::{Blit, Gpu, Paint, PresentMode, Screen, Shown, WindowHandles},
};
use std::{
    sync::{
        Arc, Mutex, PoisonError,
        mpsc::{Receiver, Sender, channel},
    },
    thread::JoinHandle,
};

/// What is drawn in one frame of the window.
pub struct WindowFrame {
    /// Width and height of the window, pixels.
    pub size: [u32; 2],
    /// When the frame is to be shown.
    pub mode: PresentMode,
    /// Pictures, and where they go.
    pub blits: Vec<Blit>,
    /// The panels over them.
    pub paint: Paint,
    /// Whether the surface is to be treated as lost.
    pub lose: bool,
}

/// Counts of what has been drawn so far.
#[derive(Clone, Debug, Default)]
pub struct PresentStats {
    /// Frames of the window that were shown.
    pub shown: u64,
    /// Frames that were not shown, because the window was hidden or had just changed.
    pub skipped: u64,
    /// How often the window's images were made anew.
    pub swapchains: u64,
    /// What ended the thread.
    pub failure: Option<String>,
    /// Whether the last frame reached the window.
    pub last_shown: bool,
}

/// The window's handle to the presenting thread.
pub struct Presenter {
    frames: Option<Sender<WindowFrame>>,
    progress: Arc<Mutex<PresentStats>>,
    thread: Option<JoinHandle<()>>,
    /// The present modes that the window offers.
    pub modes: Vec<PresentMode>,
    sent: u64,
}

impl Presenter {
    /// Starts the thread. `wake` is called after each frame.
    ///
    /// # Errors
    /// Fails if the device cannot show anything in this window.
    pub fn start(gpu: &Gpu, window: Arc<dyn WindowHandles>, wake: impl Fn() + Send + 'static) -> Result<Self> {
        let screen = Screen::new(gpu, window)?;
        let modes = screen.modes().to_vec();
        let progress = Arc::<Mutex<PresentStats>>::default();
        let (frames, inbox) = channel();
        let there = Arc::clone(&progress);
        let thread =
            std::thread::Builder::new().name("window".into()).spawn(move || run(screen, &inbox, &there, &wake));
        let thread = thread.map_err(|error| Error::Internal(format!("starting a thread: {error}")))?;
        Ok(Self { frames: Some(frames), progress, thread: Some(thread), modes, sent: 0 })
    }

    /// Hands over a frame.
    pub fn send(&mut self, frame: WindowFrame) {
        if let Some(frames) = &self.frames
            && let Err(unsent) = frames.send(frame)
        {
            forget(unsent.0);
        }
        self.sent += 1;
    }

    /// The counts so far, and whether all frames that were handed over are done.
    pub fn progress(&self) -> (PresentStats, bool) {
        let progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let done = progress.shown + progress.skipped >= self.sent;
        (progress, done)
    }
}

/// Tells egui that its textures were taken care of, as it demands.
fn forget(mut frame: WindowFrame) {
    frame.paint.textures.clear();
}

fn run(mut screen: Screen, inbox: &Receiver<WindowFrame>, progress: &Mutex<PresentStats>, wake: &dyn Fn()) {
    while let Ok(frame) = inbox.recv() {
        let lost = if frame.lose { screen.lose() } else { Ok(()) };
        let result = lost.and_then(|()| screen.show(frame.size, frame.mode, &frame.blits, frame.paint));
        let mut now = progress.lock().unwrap_or_else(PoisonError::into_inner);
        now.swapchains = screen.swapchains;
        now.last_shown = matches!(result, Ok(Shown::Yes));
        match result {
            Ok(Shown::Yes) => now.shown += 1,
            Ok(Shown::NotNow) => now.skipped += 1,
            Err(error) => now.failure = Some(error.to_string()),
        }
        let failed = now.failure.is_some();
        drop(now);
        wake();
        if failed {
            break;
        }
    }
    // The frames that were still under way are dropped here.
    inbox.try_iter().for_each(forget);
}

impl Drop for Presenter {
    fn drop(&mut self) {
        self.frames = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the window's thread panicked");
        }
    }
}
