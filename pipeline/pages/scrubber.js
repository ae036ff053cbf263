// A slider through the pictures of a run.
function showScrubber(root, pictures) {
  const image = root.querySelector("img"), slider = root.querySelector("input"), time = root.querySelector("output");
  function show() {
    const [when, source] = pictures[slider.value];
    image.src = source;
    image.alt = `the run at ${when}`;
    time.textContent = when;
    slider.setAttribute("aria-valuetext", when);
  }
  slider.addEventListener("input", show);
  show();
}
