// Robot, tool and noise of the run: a header or plan of the folder, or a new header as a form.
import { signal } from "@preact/signals";
import { getFile, Refused } from "../core/api.js";

/** @typedef {import("./sources.js").ChosenHeader} ChosenHeader */

export const NEW = "\0new"; // no file can have this name

/** What is chosen in the list: a file, NEW, or "". */
export const headerFile = signal("");
export const chosen = signal(/** @type {ChosenHeader | null} */ (null));
export const headerFault = signal("");
/** What the form of a new header begins with. */
export const beginning = signal(/** @type {Partial<import("./sources.js").HeaderContent>} */ ({}));

/** @param {string} name @param {boolean} plan */
export async function pick(name, plan) {
  headerFile.value = name;
  headerFault.value = "";
  chosen.value = null;
  if (!name || name === NEW) return;
  try {
    const found = await getFile("header", name);
    if (headerFile.value === name) chosen.value = /** @type {ChosenHeader} */ ({ ...found, plan });
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    headerFault.value = error.text;
  }
}

/** A new header, from the one that is chosen. */
export function editCopy() {
  beginning.value = chosen.value?.header ?? {};
  chosen.value = null;
  headerFile.value = NEW;
}

/** A sentence about what is chosen. @param {ChosenHeader} header */
export function about({ header, plan, notes }) {
  const robot = typeof header.robot === "string" ? header.robot
    : `${header.robot.urdf}, ${header.robot.base} to ${header.robot.tip}`;
  const instruments = Object.entries(header.instruments ?? {}).map(([name, one]) => `${name} (${one.kind})`);
  const tools = [...(header.tool ? [`${header.tool.kind}${header.tool.calibrated === false ? ", not calibrated" : ""}`]
    : []),
    ...instruments];
  const joint = [header.noise.joint_deg].flat().join(", ");
  const spot = header.noise.spot_mm ? `, ${header.noise.spot_mm} mm of a spot` : "";
  return [`Robot ${robot}; ${tools.join(", ")}; noise ${joint}° of a joint${spot}.`,
    plan ? "The plan says which posture has which target." : "", ...notes].filter(Boolean)
    .join(" ");
}
