/** What a run did with matter: yields, mass balance, and the spectra of its products. */

import { usePoints } from "@/api/files";
import { useRunReport } from "@/api/queries";
import { formatNumber, splitMass, THIN } from "@/model/format";
import type { FileReading } from "@/model/wirefiles";
import type { AccountRow, RunReport, YieldRow } from "@/model/wirereport";
import { Link } from "react-router";
import { Card, Empty, Loaded } from "@/ui/card";
import { SeriesPlot } from "@/ui/seriesplot";
import { At } from "@/ui/time";
import { words } from "./words";

const mass = (ug: number): string => splitMass(ug).join(THIN);
const mmol = (umol: number): string => `${formatNumber(umol / 1000, 2)}${THIN}mmol`;

export function RunReportTab({ runId }: { runId: string }) {
  const report = useRunReport(runId);
  return (
    <Loaded source={report} what="the report">
      {(found) => (
        <div className="col" data-testid="report">
          <Deviations report={found} />
          <Yields rows={found.yields} />
          <Masses report={found} />
          {found.readings.map((reading) => (
            <Spectrum key={reading.id} reading={reading} />
          ))}
        </div>
      )}
    </Loaded>
  );
}

/** What was in doubt, and what nobody could confirm: neither can be left out. */
function Deviations({ report }: { report: RunReport }) {
  return (
    <>
      {report.doubts.length > 0 && (
        <Card title={words.report.doubts} note={words.report.doubtsNote} testId="report-doubts">
          <ul className="reasons pb">
            {report.doubts.map((one, place) => (
              <li key={place}>
                <span>
                  {one.sentence}: {one.resolved ? one.resolved.text : words.report.openDoubt}
                  {one.resolved && (
                    <span className="m">
                      {" "}
                      asked <At at={one.resolved.doubt_at} seconds />, resolved{" "}
                      <At at={one.resolved.at} seconds />. {one.resolved.note}
                    </span>
                  )}
                </span>
              </li>
            ))}
          </ul>
        </Card>
      )}
      {report.unconfirmed.length > 0 && (
        <Card
          title={words.report.unconfirmed}
          note={words.report.unconfirmedNote}
          testId="report-unconfirmed"
        >
          <ul className="reasons pb">
            {report.unconfirmed.map((one) => (
              <li key={one.job_id}>
                {one.sentence}: {one.message}
              </li>
            ))}
          </ul>
        </Card>
      )}
    </>
  );
}

function Yields({ rows }: { rows: YieldRow[] }) {
  return (
    <Card title={words.report.yields} note={words.report.yieldsNote} testId="yields">
      {rows.length ? (
        <div className="widetable">
          <table>
            <thead>
              <tr>
                <th>{words.report.product}</th>
                <th>{words.report.standsIn}</th>
                <th className="r">{words.report.isolated}</th>
                <th>{words.report.basis}</th>
                <th className="r">{words.report.yield}</th>
              </tr>
            </thead>
            <tbody>
              {rows.map((row) => (
                <tr key={row.product_id} data-testid="yield" data-product={row.product}>
                  <td>{row.material}</td>
                  <td>{row.stands_in.map((one) => one.name).join(", ") || words.report.nowhere}</td>
                  <td className="r num">
                    {row.isolated_ug === null ? "–" : mass(row.isolated_ug)}
                    {row.isolated_umol !== null && `, ${mmol(row.isolated_umol)}`}
                  </td>
                  <td>
                    {row.basis}
                    {row.basis_umol !== null && `, ${mmol(row.basis_umol)}`}
                  </td>
                  <td className="r num" data-testid="ratio">
                    {row.ratio === null
                      ? words.report.notStated(row.missing)
                      : `${formatNumber(row.ratio * 100, 1)}${THIN}%`}
                  </td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      ) : (
        <Empty>{words.report.noYields}</Empty>
      )}
    </Card>
  );
}

function Masses({ report }: { report: RunReport }) {
  return (
    <Card title={words.report.balance} note={words.report.balanceNote} testId="balance">
      {report.taken.length + report.brought.length ? (
        <>
          <div className="widetable">
            <table>
              <thead>
                <tr>
                  <th>{words.report.account}</th>
                  <th>{words.report.lots}</th>
                  <th className="r">{words.report.mass}</th>
                </tr>
              </thead>
              <tbody>
                <Side rows={report.taken} sum={report.taken_ug} title={words.report.taken} />
                <Side rows={report.brought} sum={report.brought_ug} title={words.report.brought} />
              </tbody>
            </table>
          </div>
          <p className="help widenote" data-testid="gap" data-ug={report.gap_ug}>
            {words.report.gap(mass(Math.abs(report.gap_ug)))}
          </p>
          {report.unknown.length > 0 && (
            <p className="help bad widenote">{words.report.unknown(report.unknown)}</p>
          )}
        </>
      ) : (
        <Empty>{words.report.noBalance}</Empty>
      )}
    </Card>
  );
}

function Side({ rows, sum, title }: { rows: AccountRow[]; sum: number; title: string }) {
  return (
    <>
      {rows.map((row) => (
        <tr key={`${row.account}${row.resource_id ?? row.name}`} data-testid="account">
          <td>
            {row.resource_id ? (
              <Link className="link" to={`/lab?sel=${row.resource_id}`}>
                {row.name}
              </Link>
            ) : (
              (words.report.accounts[row.account] ?? row.name)
            )}
          </td>
          <td className="s">{row.lots.map((one) => one.lot).join(", ")}</td>
          <td className="r num">{mass(row.mass_ug)}</td>
        </tr>
      ))}
      <tr className="sum">
        <td colSpan={2}>{title}</td>
        <td className="r num">{mass(sum)}</td>
      </tr>
    </>
  );
}

function Spectrum({ reading }: { reading: FileReading & { file_id?: string } }) {
  const drawn = usePoints(reading.id, null);
  return (
    <Card
      title={reading.name}
      note={reading.quantity}
      testId="spectrum"
      actions={
        reading.file_id ? (
          <Link className="t12 s" to={`/files/${reading.file_id}`}>
            {words.report.file}
          </Link>
        ) : null
      }
    >
      <div className="pb">
        <Loaded source={drawn} what="the series">
          {(points) => <SeriesPlot drawn={points} height={280} />}
        </Loaded>
      </div>
    </Card>
  );
}
