/** What a calibration found: its points after the correction, and its levels. */

import { amountText, levelRows, residualPlot, signedText, type Kind } from "@/model/calibration";
import { formatNumber, THIN } from "@/model/format";
import type { Calibration, CalibrationResult } from "@/model/wirecalibration";

const LEFT = "What is left after the correction";

const percent = (share: number): string => `${share * 100}%`;

function Residuals({ row, kind }: { row: Calibration; kind: Kind }) {
  const plot = residualPlot(row, kind);
  if (!plot) return null;
  const [upper, lower] = plot.limits;
  return (
    <figure className="residuals" data-testid="residuals">
      <figcaption className="t12 m">{LEFT}</figcaption>
      <div
        className="field2d"
        role="img"
        aria-label={`${LEFT}: ${plot.dots.length} points, limits ± ${amountText(row.tolerance, kind)}`}
      >
        <i className="rule zero" style={{ top: "50%" }} />
        <i className="rule limit" style={{ top: percent(upper) }} />
        <i className="rule limit" style={{ top: percent(lower) }} />
        {plot.dots.map((dot, at) => (
          <i
            key={at}
            className="dot"
            style={{ left: percent(dot.x), top: percent(dot.y) }}
            title={`${formatNumber(dot.value, 1)}${THIN}${kind.unit}: ${signedText(dot.residual, kind)}`}
          />
        ))}
        <span className="tick num" style={{ top: percent(upper) }}>
          +{amountText(row.tolerance, kind)}
        </span>
        <span className="tick num" style={{ top: "50%" }}>
          0
        </span>
        <span className="tick num" style={{ top: percent(lower) }}>
          −{amountText(row.tolerance, kind)}
        </span>
      </div>
      <div className="xaxis t12 m num">
        <span>{formatNumber(plot.start, 0)}</span>
        <span>
          {formatNumber(plot.end, kind.is_relative ? 0 : 2)}
          {THIN}
          {kind.unit}
        </span>
      </div>
    </figure>
  );
}

/** Gain of a pump; gain and offset of a probe; slope and offset of an electrode. */
export function slopeText(result: CalibrationResult, kind: Kind): string {
  if (result.slope_pct === null || result.offset_mv === null) {
    const gain = formatNumber(result.gain, 5);
    return kind.is_relative ? gain : `${gain}, offset ${signedText(result.offset, kind)}`;
  }
  const slope = `${formatNumber(result.slope_pct, 1)}${THIN}%`;
  return `${slope} of Nernst, ${formatNumber(result.offset_mv, 1)}${THIN}mV at pH 7`;
}

export function Levels({ row, kind }: { row: Calibration; kind: Kind }) {
  const rows = levelRows(row, kind);
  if (!rows.length) return null;
  return (
    <div className="callevels">
      <Residuals row={row} kind={kind} />
      <table>
        <thead>
          <tr>
            <th className="r">Level</th>
            <th className="r">As found</th>
            <th className="r">Left</th>
            <th className="r">Uncertainty</th>
          </tr>
        </thead>
        <tbody>
          {rows.map((one) => (
            <tr key={one.level} className="num">
              <td className="r">
                {formatNumber(one.level, kind.is_relative ? 0 : 2)}
                {THIN}
                {kind.unit}
              </td>
              <td className="r">{signedText(one.found, kind)}</td>
              <td className="r">{signedText(one.left, kind, 3)}</td>
              <td className="r">± {amountText(one.expanded, kind)}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}
