// What is said of a film at one of its instants: of the singular instant that is nearest in time.

// The words at time t, as HTML, and the state that they tell: singular, unbounded, unreal or none of them.
function spoken(film, t, g, power) {
  const { content } = film;
  const nearest = content.instants.reduce((best, each) => (!best || Math.abs(each.time - t) < Math.abs(best.time - t) ? each : best), null);
  const unreal = t > film.end + 1e-9 && !film.singular(nearest, t);
  const near = film.g && Math.abs(g) < 0.25 * film.largestG;
  const when = nearest && `<span class="whole">t = ${rounded(nearest.time)} s</span>`;
  const now = `<b class="whole">${steady(power, content.shared_force)} ${content.unit}</b>`;
  const hold = near ? "Along t<sub>s</sub> the motors have little hold" : "The motors hold the platform in every direction";
  const asked = `${content.asked} t<sub>s</sub>`;
  let state = "", text;
  if (!film.g) {
    text = "<b>Every joint has a motor.</b> This robot has no Type 2 singularity.";
  } else if (!nearest) {
    text = `<b>No singularity on this path.</b> ${hold}.`;
  } else if (film.singular(nearest, t) && content.proved) {
    state = "singular";
    text = `<b>Singular now.</b> ${symbols(content.why)} ${symbols(nearest.how)} The torque stays finite.`;
  } else if (film.singular(nearest, t)) {
    state = "unbounded";
    text = `<b>Singular now.</b> ${symbols(content.why)} The motion asks for ${rounded(Math.abs(nearest.wrench))} ${content.unit} ${content.asked.split(" ")[1]} t<sub>s</sub>: no motor torque is large enough.`;
  } else if (unreal) {
    state = "unreal";
    text = `<b>The real robot would not get here</b>: no torque carries it through ${when}. Shown for comparison.`;
  } else if (t < nearest.time) {
    const then = content.proved ? `must reach 0 by ${when}` : `must reach 0 by ${when}, and does not`;
    text = `<b>${near ? "Near" : "Before"} the singularity.</b> ${hold}. The ${asked}, now ${now}, ${then}.`;
  } else {
    text = `<b>${near ? "Just past" : "Past"} the singularity.</b> ${hold}${near ? " yet" : " again"}. The ${asked}, now ${now}, was 0 at ${when}.`;
  }
  return { text, state };
}
