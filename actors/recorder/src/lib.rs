//! State to Rerun: a tap on its own thread, never in the path.
