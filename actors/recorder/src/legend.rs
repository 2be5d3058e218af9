//! The page that explains the views.

/// The legend, in Markdown.
pub(crate) const TEXT: &str = "\
# What you see

**Robot and world**
- the robot's body parts in muted colors; a shape turns **red** while it is nearer to another one than the reflex's
  margin, and **magenta** if it touches
- small red dots: places where contacts began so far
- bright lines: the way the hands went during the last half minute
- solid objects are obstacles or targets, see-through ones are ghosts
- solid **orange** objects are in the simulated world only: the arm touches them, and the model does not contain them
- pyramids of thin lines: cameras, with what they see; what a detector takes for its object is tinted, and boxed in **red**

**Roadmap** (flat: the hand's places as seen from the front)
- circles: vertices, poses where the robot may rest, with the names of their poses, else numbers
- **green, thick**: driven to its end, feasible
- gray, thin: not tried yet, taken for feasible
- amber: not tried, the opposite direction failed
- red, dashed: tried, failed and removed
- **bright red, thick**: the plan that is followed now

**States**: of the filtered interface that carries an agent's commands, and of the present transaction, over the whole run.
Zoom with Ctrl and the wheel, pan by dragging; a double click shows all of it again.

Move the cursor in the time line below, or press play.
";
