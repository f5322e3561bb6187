/** Files that are dropped or chosen: which of them is what. */

const SAYS = [
  ["calibration", /calib|\.(txt|ya?ml|json|toml|xml)$/i],
  ["truth", /truth|disp|(^|[-_.])gt|gt[-_.0-9]|\.npy$/i],
  ["right", /right|(^|[-_.])r([-_.0-9]|$)|im(age)?_?[13]\b|image_?3|im1|_10_r|view5|cam1/i],
  ["left", /left|(^|[-_.])l([-_.0-9]|$)|im(age)?_?[02]\b|image_?2|im0|_10_l|view1|cam0/i],
];

/**
 * What each file is, by its name: {left, right, truth, calibration, disparity}. Two that say nothing are left and right in
 * the order of their names; a map alone, or beside a left image alone, is what is to be looked at.
 */
export function guess(files) {
  const found = {};
  const rest = [];
  for (const file of [...files].sort((a, b) => a.name.localeCompare(b.name, undefined, { numeric: true }))) {
    const role = SAYS.find(([role, says]) => says.test(file.name) && !found[role])?.[0];
    if (role) found[role] = file;
    else rest.push(file);
  }
  for (const role of ["left", "right", "truth"]) if (!found[role] && rest.length) found[role] = rest.shift();
  if (found.truth && !found.right) {
    found.disparity = found.truth;
    delete found.truth;
  }
  return found;
}

export function formOf(found) {
  const form = new FormData();
  for (const [role, file] of Object.entries(found)) if (file?.size !== undefined && file.name) form.append(role, file, file.name);
  return form;
}

/** Call `open(form)` with files that are dropped anywhere on the page. */
export function acceptDrops(curtain, open) {
  let depth = 0;
  const holdsFiles = (event) => [...(event.dataTransfer?.types ?? [])].includes("Files");
  const show = (shown) => (curtain.hidden = !shown);
  addEventListener("dragenter", (event) => holdsFiles(event) && show(++depth > 0));
  addEventListener("dragleave", (event) => holdsFiles(event) && show(--depth > 0));
  addEventListener("dragover", (event) => holdsFiles(event) && event.preventDefault());
  addEventListener("drop", (event) => {
    if (!holdsFiles(event)) return;
    event.preventDefault();
    depth = 0;
    show(false);
    open(formOf(guess(event.dataTransfer.files)));
  });
}

/** Ask for files in a dialog; what is left open is guessed from nothing. */
export function askForFiles(dialog, open) {
  const form = dialog.querySelector("form");
  form.reset();
  dialog.returnValue = "";
  dialog.showModal();
  dialog.onclose = () => {
    if (dialog.returnValue !== "open") return;
    const chosen = Object.fromEntries([...form.querySelectorAll("input[type=file]")].map((input) => [input.name, input.files[0]]).filter(([, file]) => file));
    if (Object.keys(chosen).length) open(formOf(chosen));
  };
}
