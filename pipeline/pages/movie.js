// The movie of a page: picture by picture, and enlarged. Safari plays no movie from a data URL, so it becomes a file here.
const BUTTONS = 72;  // pixels

function showMovie(root) {
  const video = root.querySelector("video");
  const bytes = Uint8Array.from(atob(video.getAttribute("src").split(",")[1]), letter => letter.charCodeAt(0));
  // The buttons of the browser lie over the foot of a video: it is made higher than its picture, whose legend is there.
  const makeRoom = () => {
    const height = video.clientWidth * video.videoHeight / video.videoWidth;
    if (height) video.style.aspectRatio = `${video.clientWidth} / ${height + BUTTONS}`;
  };
  video.addEventListener("loadedmetadata", makeRoom);
  addEventListener("resize", makeRoom);
  video.poster = root.querySelector("img").src;  // which is printed in its place
  video.src = URL.createObjectURL(new Blob([bytes], {type: "video/mp4"}));
  root.querySelectorAll("[data-step]").forEach(button => button.addEventListener("click", () => {
    const step = Number(button.dataset.step), length = Math.abs(step);
    video.pause();
    // The middle of a picture: at its edge a browser may show the one before.
    const at = (Math.floor(video.currentTime / length + 1e-3) + Math.sign(step) + 0.5) * length;
    video.currentTime = Math.max(0.5 * length, Math.min(at, video.duration - 0.01));
  }));
  root.querySelector("[data-enlarge]").addEventListener("click", () => {
    if (document.fullscreenElement) document.exitFullscreen();
    else if (video.requestFullscreen) video.requestFullscreen();
    else video.webkitEnterFullscreen();  // on an iPhone
  });
}
