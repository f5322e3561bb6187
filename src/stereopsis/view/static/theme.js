/** Light, dark, or as the system has it. */

const dark = matchMedia("(prefers-color-scheme: dark)");

export function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : dark.matches;
}

export function theme(box, changed) {
  const apply = () => {
    if (box.value) document.documentElement.dataset.theme = box.value;
    else delete document.documentElement.dataset.theme;
  };
  try {
    box.value = localStorage.getItem("stereopsis-theme") ?? "";
  } catch {
    // Storage is refused: the choice lasts as long as the page.
  }
  apply();
  box.addEventListener("change", () => {
    try {
      localStorage.setItem("stereopsis-theme", box.value);
    } catch {
      // As above.
    }
    apply();
    changed();
  });
  dark.addEventListener("change", changed);
}
