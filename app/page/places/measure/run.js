// What the events of a run say, one after another (docs/files.md): a value that the place shows.

export const begun = () => ({
  file: "", rig: "", postures: 0, recorded: [], refused: [], tolerance: null, shot: null, attempt: 1, phase: "", trace: [], size: null,
  arm: null, picture: null, std: null, consistent: true, course: [], asked: null, doubt: null, confirm: null, trouble: "", suspect: null, stopped: null, end: null,
});

const known = (now, event) => {
  now.std = event.std;
  now.consistent = event.consistent;
  now.course.push({ recorded: event.recorded, std: event.std });
};

const HEARD = {
  begin: (now, e) => Object.assign(now, begun(), { file: e.file, rig: e.rig, postures: e.postures, recorded: [...e.recorded], tolerance: e.tolerance }),
  confirm: (now, e) => { now.confirm = e.text; },
  shot: (now, e) => Object.assign(now, { shot: e.shot, attempt: e.attempt, phase: "", trace: [], confirm: null }),
  phase: (now, e) => { now.phase = e.phase; },
  spot: (now, e) => { now.trace.push(e); now.size = e.size_mm; },
  arm: (now, e) => { now.arm = e; },
  picture: (now, e) => { now.picture = e; },
  retry: (now, e) => { now.trouble = `Measurement ${e.shot}, attempt ${e.attempt} was refused (${e.reason}): ${e.found}`; },
  refused: (now, e) => { now.refused.push(e.shot); now.doubt = null; now.trouble = `Measurement ${e.shot} was refused (${e.reason}): ${e.found}`; },
  recorded: (now, e) => { now.recorded.push(e.shot); now.doubt = null; now.suspect = null; known(now, e); },
  posture: (now, e) => Object.assign(now, { asked: e, shot: e.shot, doubt: null }),
  doubt: (now, e) => { now.doubt = e; },
  withdrawn: (now, e) => { now.recorded = now.recorded.filter((shot) => shot !== e.shot); now.course.pop(); now.doubt = null; now.suspect = null; },
  suspect: (now, e) => { now.suspect = e; },
  stopped: (now, e) => { now.stopped = e.why; now.shot = null; },
  end: (now, e) => { now.end = e; now.shot = null; },
};

export function hear(now, event) {
  if (Object.hasOwn(HEARD, event.event)) HEARD[event.event](now, event);
}
