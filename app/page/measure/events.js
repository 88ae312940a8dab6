// What the events of a run say, one after another (docs/files-cell.md). Measurements have the numbers of the file, of
// the sheet and of the report.

/**
 * @typedef {Pick<import("answers").MeasurementRecorded, "recorded" | "std" | "expanded">} CoursePoint
 * @typedef {{shot: number, text: string, bad: boolean}} Line
 * @typedef {import("answers").Ended & {action?: import("answers").OfferedAction | null}} End
 * @typedef {{file: string, rig: string, postures: number, recorded: number[], refused: number[], tolerance: number |
 *   null, shot: number | null, attempt: number, phase: string, trace: import("answers").SpotSeen[],
 *   kept: import("answers").SpotSeen[], size: number | null, arm: import("answers").ArmSent | null,
 *   camera: import("answers").PictureTaken | null, consistent: boolean, warning: string | null, course: CoursePoint[],
 *   tolerances: Record<string, number>, residuals: Record<string, number>,
 *   asked: import("answers").PostureRequested | null, reading: import("answers").ReadingRequested | null,
 *   doubt: import("answers").Doubted | null, confirm: string | null, trouble: string,
 *   suspect: import("answers").Suspected | null, stopped: string | null, end: End | null, lines: Line[]}} RunSeen
 */

/** @returns {RunSeen} */
export const begun = () => ({
  file: "", rig: "", postures: 0, recorded: [], refused: [], tolerance: null, shot: null, attempt: 1, phase: "",
  trace: [], kept: [], size: null, arm: null, camera: null, consistent: true, warning: null, course: [],
  tolerances: {}, residuals: {}, asked: null, reading: null, doubt: null, confirm: null, trouble: "", suspect: null,
  stopped: null, end: null, lines: [],
});

/** @param {RunSeen} now @param {{shot: number, line: string}} event @param {boolean} [bad] */
const noted = (now, { shot, line }, bad = false) => [...now.lines, { shot, text: line, bad }];
/** @param {{shot: number, line: string}} event */
const trouble = ({ shot, line }) => `Measurement ${shot}: ${line}`;

const OF_READINGS = ["metres", "unreadable", "help"]; // kinds of doubts that may be about what an instrument reads

/**
 * The record of each kind of event.
 * @typedef {{begin: import("answers").RunOpened, confirm: import("answers").ConfirmationAsked,
 *   shot: import("answers").Attempted, phase: import("answers").PhaseBegun, spot: import("answers").SpotSeen,
 *   arm: import("answers").ArmSent, picture: import("answers").PictureTaken, retry: import("answers").Retried,
 *   refused: import("answers").GivenUp, recorded: import("answers").MeasurementRecorded,
 *   posture: import("answers").PostureRequested, reading: import("answers").ReadingRequested,
 *   doubt: import("answers").Doubted, withdrawn: import("answers").Withdrawn, suspect: import("answers").Suspected,
 *   stopped: import("answers").Stopped, end: End}} Kinds
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
  retry: (now, e) => ({ trouble: trouble(e), lines: noted(now, e, true) }),
  refused: (now, e) =>
    ({ refused: [...now.refused, e.shot], doubt: null, trouble: trouble(e), lines: noted(now, e, true) }),
  recorded: (now, e) => ({
    recorded: [...now.recorded, e.shot], doubt: null, suspect: null, reading: null, consistent: e.consistent,
    warning: e.warning, course: [...now.course, e], tolerances: e.tolerance, residuals: e.residuals,
    kept: [...now.kept, ...now.trace.slice(-1)], lines: noted(now, e),
  }),
  posture: (_, e) => ({ asked: e, shot: e.shot, doubt: null, reading: null }),
  // asked for again after a doubt about it
  reading: (now, e) =>
    ({ shot: e.shot, reading: e, doubt: now.doubt && OF_READINGS.includes(now.doubt.kind) ? now.doubt : null }),
  doubt: (_, e) => ({ doubt: e }),
  withdrawn: (now, e) =>
    ({ recorded: now.recorded.filter((shot) => shot !== e.shot), course: now.course.slice(0, -1), residuals: {},
      doubt: null, suspect: null, lines: noted(now, e) }),
  suspect: (now, e) => ({ suspect: e, lines: noted(now, e, true) }),
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
