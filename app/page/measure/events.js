// What the events of a run say, one after another (docs/files-cell.md). Measurements have the numbers of the file, of
// the sheet and of the report.

/**
 * @typedef {{recorded: number, std: Record<string, number | null>, expanded: Record<string, number |
 *   null>}} CoursePoint
 * @typedef {Record<string, number>} Residuals normalised, by number of the measurement
 * @typedef {{key: string, words: string, numbers: number}} Entered what is read off the instrument
 * @typedef {{shot: number, off_mm: number, at_mm: [number, number] | null, size_mm: number | null}} Spot
 * @typedef {{shot: number, joints_deg: number[], arm: import("../scene/types.js").Vec[],
 *   beam: import("../scene/types.js").Vec[], target: import("../scene/types.js").Vec, lit: boolean}} ArmSent
 * @typedef {{shot: number, target: string, done: number, postures: number, pendant: {name: string, value: number,
 *   unit: string}[], reads: Entered[], reflector: string | null, instrument: string | null, act: string,
 *   also: number[], again: number | null}} Asked
 * @typedef {{shot: number, reads: Entered[], instrument: string | null, reflector: string | null}} ReadingAsked
 * @typedef {{shot: number, kind: string, found: string, answers: string[]}} Doubt
 * @typedef {{width: number, height: number, grey: string}} Camera
 * @typedef {{verdict: string, message: import("../parts/Message.js").MessageFacts,
 *   action?: import("answers").OfferedAction | null, notes: string[], parameters: {name: string, unit: string}[]}} End
 * @typedef {{shot: number, text: string, bad: boolean}} Line
 * @typedef {{file: string, rig: string, postures: number, recorded: number[], refused: number[], tolerance: number |
 *   null, shot: number | null, attempt: number, phase: string,
 *   trace: Spot[], kept: Spot[], size: number | null, arm: ArmSent | null, camera: Camera | null, consistent: boolean,
 *   course: CoursePoint[],
 *   tolerances: Record<string, number>, residuals: Residuals, asked: Asked | null, reading: ReadingAsked | null,
 *   doubt: Doubt | null, confirm: string | null, trouble: string, suspect: {shot: number, residual_mm: number} | null,
 *   stopped: string | null, end: End | null, lines: Line[]}} RunSeen
 */

/** @returns {RunSeen} */
export const begun = () => ({
  file: "", rig: "", postures: 0, recorded: [], refused: [], tolerance: null, shot: null, attempt: 1, phase: "",
  trace: [], kept: [], size: null,
  arm: null, camera: null, consistent: true, course: [], tolerances: {}, residuals: {}, asked: null, reading: null,
  doubt: null, confirm: null, trouble: "", suspect: null, stopped: null, end: null, lines: [],
});

/** @param {RunSeen} now @param {number} shot @param {string} text @param {boolean} [bad] */
const noted = (now, shot, text, bad = false) => [...now.lines, { shot, text, bad }];

/** @param {Spot | undefined} spot */
const leftAt = (spot) => (spot ? `, spot ${spot.off_mm.toFixed(4)} mm from the centre` : "");

const OF_READINGS = ["metres", "unreadable", "help"]; // kinds of doubts that may be about what an instrument reads

/**
 * What each kind of event brings.
 * @typedef {{
 *   begin: {file: string, rig: string, postures: number, recorded: number[], tolerance: number | null},
 *   confirm: {text: string}, shot: {shot: number, attempt: number}, phase: {phase: string}, spot: Spot, arm: ArmSent,
 *   picture: Camera,
 *   retry: {shot: number, attempt: number, reason: string, found: string}, refused: {shot: number, reason: string,
 *   found: string},
 *   recorded: {shot: number, consistent: boolean, recorded: number, seconds: number | null, std: CoursePoint["std"],
 *     expanded: CoursePoint["expanded"], tolerance: Record<string, number>, residuals: Residuals},
 *   posture: Asked, reading: ReadingAsked, doubt: Doubt, withdrawn: {shot: number}, suspect: {shot: number,
 *   residual_mm: number},
 *   stopped: {why: string}, end: End}} Kinds
 * @typedef {{event: string}} RunEvent with the keys of its kind
 */
/** @type {{[K in keyof Kinds]: (now: RunSeen, e: Kinds[K]) => Partial<RunSeen>}} */
const HEARD = {
  begin: (_, e) =>
    ({ ...begun(), file: e.file, rig: e.rig, postures: e.postures, recorded: [...e.recorded], tolerance: e.tolerance }),
  confirm: (_, e) => ({ confirm: e.text }),
  shot: (_, e) => ({ shot: e.shot, attempt: e.attempt, phase: "", trace: [], confirm: null }),
  phase: (_, e) => ({ phase: e.phase }),
  spot: (now, e) => ({ trace: [...now.trace, e], size: e.size_mm }),
  arm: (_, e) => ({ arm: e }),
  picture: (_, e) => ({ camera: e }),
  retry: (now, e) =>
    ({ trouble: `Measurement ${e.shot}, attempt ${e.attempt} was refused (${e.reason}): ${e.found}`,
      lines: noted(now, e.shot, `attempt ${e.attempt} refused (${e.reason}): ${e.found}`, true) }),
  refused: (now, e) =>
    ({ refused: [...now.refused, e.shot], doubt: null,
      trouble: `Measurement ${e.shot} was refused (${e.reason}): ${e.found}`,
      lines: noted(now, e.shot, `refused (${e.reason}): ${e.found}`, true) }),
  recorded: (now, e) => ({
    recorded: [...now.recorded, e.shot], doubt: null, suspect: null, consistent: e.consistent,
    course: [...now.course, { recorded: e.recorded, std: e.std, expanded: e.expanded }], tolerances: e.tolerance,
    residuals: e.residuals, reading: null,
    kept: now.trace.length ? [...now.kept, /** @type {Spot} */ (now.trace.at(-1))] : now.kept,
    lines: noted(now, e.shot, `recorded${e.seconds ? ` in ${e.seconds.toFixed(1)} s` : ""}${leftAt(now.trace.at(-1))}`),
  }),
  posture: (_, e) => ({ asked: e, shot: e.shot, doubt: null, reading: null }),
  reading: (now, e) =>
    ({ shot: e.shot, reading: e, doubt: now.doubt && OF_READINGS.includes(now.doubt.kind) ? now.doubt : null }),
  // asked for again after a doubt about it
  doubt: (_, e) => ({ doubt: e }),
  withdrawn: (now, e) =>
    ({ recorded: now.recorded.filter((shot) => shot !== e.shot), course: now.course.slice(0, -1), residuals: {},
      doubt: null, suspect: null, lines: noted(now, e.shot, "withdrawn, to be measured again") }),
  suspect: (now, e) =>
    ({ suspect: e,
      lines: noted(now, e.shot, `contradicts the others: residual ${e.residual_mm.toFixed(3)} mm`, true) }),
  stopped: (_, e) => ({ stopped: e.why, shot: null }),
  end: (_, e) => ({ end: e, shot: null }),
};

/** @param {RunSeen} now @param {RunEvent} event @returns {RunSeen} */
export function heard(now, event) {
  if (!Object.hasOwn(HEARD, event.event)) return now;
  const kind = /** @type {keyof Kinds} */ (event.event);
  const hear = /** @type {(now: RunSeen, e: unknown) => Partial<RunSeen>} */ (HEARD[kind]);
  return { ...now, ...hear(now, event) };
}
